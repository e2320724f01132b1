"""Rotated, cosine-weighted BRDF lobes: the parametric functions rho_j of the mixture [WDR11 Eq. 3].

Only here, and in its Jacobian, are directions rotated into the frame of a lobe and the factor
n_j . wi applied. Lobes are evaluated model by model, so J of them cost one pass a model, not one a
lobe.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY
from ..geometry.directions import (
    disk_from_normal,
    normal_from_disk,
    project_disk,
)
from ..geometry.shapes import broadcast_shape
from .ragged import Grouped, Spans, groups, in_spans
from .values import eval_model, eval_models

# Values of one block of lobes: few enough for the cache of a CPU core, enough to fill a GPU.
CPU_BLOCK = 1 << 18
CUDA_BLOCK = 1 << 27
# Search coordinates of a lobe: disk x, disk y, angle, then the parameters on [0, 1].
COORDINATES = 3 + MAX_PARAMETERS


@dataclass(frozen=True)
class LobeBatch:
    """J lobes of any models.

    Attributes:
        model: index into `MODEL_NAMES`, `[J]` long.
        kappa: parameters of the models in their own units, `[J, MAX_PARAMETERS]`, zero-padded.
        normal: unit normals n_j in texel coordinates, `[J, 3]`.
        angle: rotation of the tangent about the normal in radians, `[J]`; 0 for isotropic models.
        horizon: angle over its own horizon within which a lobe fades for views, in radians; 0 cuts
            it hard, as the paper does.
        lowest: z of the lowest measured light, below which lobes fade; 0 lets none fade.
    """

    model: Tensor
    kappa: Tensor
    normal: Tensor
    angle: Tensor
    horizon: float = 0.0
    lowest: float = 0.0

    def __len__(self) -> int:
        return self.model.shape[0]

    def __getitem__(self, index: Tensor | slice) -> LobeBatch:
        """The lobes at `index` (long or bool tensor, or slice)."""
        return self._with(part[index] for part in self._parts())

    def to(self, device: torch.device | str) -> LobeBatch:
        """The same lobes on another device."""
        return self._with(part.to(device) for part in self._parts())

    def detach(self) -> LobeBatch:
        """The same lobes without their autograd graph."""
        return self._with(part.detach() for part in self._parts())

    @staticmethod
    def cat(batches: Sequence[LobeBatch]) -> LobeBatch:
        """The lobes of several batches, one batch after another, that end as those of the first."""
        columns = zip(*(batch._parts() for batch in batches), strict=True)
        return batches[0]._with(torch.cat(column) for column in columns)

    def narrowed(self, factor: Tensor) -> LobeBatch:
        """The same lobes with widths times `factor [J]`."""
        kappa = self.kappa.clone()
        for index, rows in self.by_model():
            for column, row in enumerate(REGISTRY[index].parameters):
                if row.from_width is not None:
                    power = math.log2(row.from_width(2.0) / row.from_width(1.0))
                    kappa[rows, column] *= factor[rows] ** power
        return replace(self, kappa=kappa)

    def by_model(self) -> Iterator[tuple[int, Tensor]]:
        """Every model in use: (index into `MODEL_NAMES`, ascending indices `[N]` of its lobes)."""
        return groups(self.model, len(REGISTRY))

    def names(self) -> list[str]:
        """The name of the model of each lobe."""
        return [MODEL_NAMES[index] for index in self.model.tolist()]

    def eval(self, wi: Tensor, wo: Tensor) -> Tensor:
        """rho_j(wi, wo) of every lobe [WDR11 Eq. 3].

        Args:
            wi: light directions `[1 or J, ..., 3]`.
            wo: view directions `[1 or J, ..., 3]`; middle dimensions broadcast with those of wi,
                so `[1, 1, L, 3]` and `[1, V, 1, 3]` evaluate a whole grid of pairs.

        Returns:
            `[J, ...]`, in 1/sr, with the factor n_j . wi; 0 where wi or wo is under the horizon of
            the lobe or of the texel.

        Raises:
            DataError: lobes or directions in float16 or bfloat16.
        """
        shape = broadcast_shape(wi.shape[1:-1], wo.shape[1:-1])
        if in_one_block(wi, len(self) * shape.numel()):
            return together(self.model, partial(self._eval_together, wi, wo))
        blocks = list(self._blocks(wi, wo))
        if not blocks:
            return wi.new_zeros(0, *shape)
        order = torch.cat([index for index, _ in blocks])
        value = torch.cat([part for _, part in blocks])
        if bool((order[1:] > order[:-1]).all()):
            return value
        return value.index_select(0, torch.argsort(order))

    def _eval_together(self, wi: Tensor, wo: Tensor, spans: Spans, order: Tensor) -> Tensor:
        """`eval` of lobes in the order of their models, given by `order [J]` and `spans`."""
        part_wi = wi if wi.shape[0] == 1 else wi.index_select(0, order)
        part_wo = wo if wo.shape[0] == 1 else wo.index_select(0, order)
        _, kappa, normal, angle = (part.index_select(0, order) for part in self._parts())
        return eval_models(spans, kappa, normal, angle, part_wi, part_wo, self.horizon, self.lowest)

    def eval_grid(self, light: Tensor, view: Tensor) -> Tensor:
        """rho_j on all pairs of lights `[L, 3]` and views `[V, 3]`: `[J, D]` [WDR11 Eq. 3]."""
        return self.eval(light[None, None], view[None, :, None]).flatten(1)

    def _blocks(self, wi: Tensor, wo: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
        """(indices `[B]`, values `[B, ...]`) of lobes in blocks of one model that fit the cache."""
        shape = broadcast_shape(wi.shape[1:-1], wo.shape[1:-1])
        budget = CUDA_BLOCK if wi.is_cuda else CPU_BLOCK
        size = max(1, budget // max(1, shape.numel()))
        for model, rows in self.by_model():
            for index in rows.split(size):
                part_wi = wi if wi.shape[0] == 1 else wi.index_select(0, index)
                part_wo = wo if wo.shape[0] == 1 else wo.index_select(0, index)
                kappa = self.kappa.index_select(0, index)
                normal = self.normal.index_select(0, index)
                angle = self.angle.index_select(0, index)
                ends = self.horizon, self.lowest
                yield index, eval_model(model, kappa, normal, angle, part_wi, part_wo, *ends)

    def _with(self, parts: Iterable[Tensor]) -> LobeBatch:
        """Lobes of other tensors, in the order of `_parts`, that end as these do."""
        model, kappa, normal, angle = parts
        return replace(self, model=model, kappa=kappa, normal=normal, angle=angle)

    def _parts(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """All tensors, in the order of the fields."""
        return self.model, self.kappa, self.normal, self.angle


def in_one_block(tensor: Tensor, values: int) -> bool:
    """Whether so many values of lobes are computed by `together`: on a GPU, without gradients.

    Gradients are taken block by block, as on a CPU.

    Args:
        tensor: on the device of the lobes, `[...]`.
        values: their number.
    """
    return tensor.is_cuda and not torch.is_grad_enabled() and 0 < values <= CUDA_BLOCK


def together(
    model: Tensor, values: Callable[[Spans, Tensor], Tensor], grouped: Grouped | None = None
) -> Tensor:
    """Values `[J, ...]` of lobes of all models in one block, which has far fewer operations.

    Args:
        model: of the lobes, `[J]`.
        values: function of where each model lies among the sorted lobes, and of their order `[J]`;
            it gives the values in that order.
        grouped: of `model`, where it is known; the host waits to know it.
    """
    order, spans = grouped or in_spans(model, len(REGISTRY))
    return values(spans, order).index_select(0, torch.argsort(order))


def anisotropic_mask(model: Tensor) -> Tensor:
    """True for each lobe of `model [J]` whose BRDF has a tangent."""
    return _scales(type(model), model.device, torch.float32)[:, -1][model] > 0.0


def decode(model: Tensor, coordinates: Tensor, horizon: float = 0.0) -> LobeBatch:
    """Lobes of search coordinates `[J, COORDINATES]`: disk x and y, angle, parameters on [0, 1].

    The map is smooth, so the search can differentiate it. `horizon` is that of `LobeBatch`.
    """
    kappa = torch.zeros_like(coordinates[:, 3:])
    for index, rows in groups(model, len(REGISTRY)):
        table = REGISTRY[index].parameters
        if table:
            unit = coordinates.index_select(0, rows)[:, 3 : 3 + len(table)].unbind(-1)
            values = [row.from_unit(column) for row, column in zip(table, unit, strict=True)]
            padding = [torch.zeros_like(values[0])] * (MAX_PARAMETERS - len(table))
            kappa = kappa.index_copy(0, rows, torch.stack(values + padding, dim=-1))
    turn = anisotropic_mask(model).to(coordinates.dtype)
    normal, angle = normal_from_disk(coordinates[:, :2]), coordinates[:, 2] * turn
    return LobeBatch(model, kappa, normal, angle, horizon)


def decoded(spans: Spans, coordinates: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """kappa `[J, P]`, normals `[J, 3]` and angles `[J]` of lobes in the order of their models.

    As by `decode`, of search `coordinates [J, COORDINATES]`.
    """
    table = Scales.of(spans, coordinates)
    angle = coordinates[:, 2] * table.turn
    return table.values(coordinates[:, 3:]), normal_from_disk(coordinates[:, :2]), angle


def encode(lobes: LobeBatch) -> Tensor:
    """The search coordinates `[J, COORDINATES]` of lobes; the inverse of `decode`."""
    unit = torch.zeros_like(lobes.kappa)
    for index, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[index].parameters):
            unit[rows, column] = row.to_unit(lobes.kappa[rows, column])
    return torch.cat((disk_from_normal(lobes.normal), lobes.angle[:, None], unit), dim=1)


@dataclass(frozen=True)
class Scales:
    """The scales of the parameters of J lobes, so that lobes of all models share operations.

    Attributes:
        low, rate, step: of `low exp(rate unit) + step unit`, `[J, MAX_PARAMETERS]`; rate is 0 on
            a linear scale, step on a logarithmic one.
        turn: 1 for lobes that have a tangent, else 0, `[J]`.
    """

    low: Tensor
    rate: Tensor
    step: Tensor
    turn: Tensor

    @classmethod
    def of(cls, spans: Spans, like: Tensor) -> Scales:
        """Those of J lobes in the order of their models, as `like [...]` in type and device."""
        table = _scales(type(like), like.device, like.dtype)  # [models, 3 MAX_PARAMETERS + 1]
        rows = (
            torch.cat([table[index].expand(own.stop - own.start, -1) for index, own in spans])
            if spans
            else table[:0]
        )
        low, rate, step = rows[:, :-1].unflatten(1, (3, MAX_PARAMETERS)).unbind(1)
        return cls(low, rate, step, rows[:, -1])

    def values(self, unit: Tensor) -> Tensor:
        """Parameters in their own units at `unit [J, MAX_PARAMETERS]`, as `Parameter.from_unit`."""
        return self.low * torch.exp(unit * self.rate) + self.step * unit

    def slopes(self, kappa: Tensor) -> Tensor:
        """d kappa / d unit at parameters `kappa [J, MAX_PARAMETERS]`."""
        return self.rate * kappa + self.step


@cache
def _scales(kind: type[Tensor], device: torch.device, dtype: torch.dtype) -> Tensor:
    """Rows of `Scales` for all models, `[models, 3 MAX_PARAMETERS + 1]`: low, rate, step, turn.

    A simulated device has tensors of a `kind` of their own.
    """
    rows = []
    for brdf in REGISTRY:
        pairs = [(row, row.scale == "log") for row in brdf.parameters]
        rate = [math.log(row.high / row.low) if log else 0.0 for row, log in pairs]
        step = [0.0 if log else row.high - row.low for row, log in pairs]
        padding = [0.0] * (MAX_PARAMETERS - len(pairs))
        low = [row.low for row in brdf.parameters]
        own = [*low, *padding, *rate, *padding, *step, *padding]
        rows.append([*own, float(brdf.anisotropic)])
    return torch.tensor(rows, dtype=dtype, device=device)


@dataclass(frozen=True)
class Feasible:
    """Bounds of the search coordinates: those of the parameters, and a least width of lobes.

    Attributes:
        low, high: bounds of the parameters on [0, 1], `[len(MODEL_NAMES), MAX_PARAMETERS]`.
        gap: ends of an interval that parameters leave out, `[2, len(MODEL_NAMES), MAX_PARAMETERS]`;
            None: there is none.
    """

    low: Tensor
    high: Tensor
    gap: Tensor | None = None

    @classmethod
    def build(cls, min_width: float) -> Feasible:
        """Bounds of lobes at least `min_width` wide, see `Parameter.from_width`.

        A lobe narrower than the angular sampling can match one sample and be wrong between samples.
        """
        low = torch.zeros(len(MODEL_NAMES), MAX_PARAMETERS)
        high = torch.zeros(len(MODEL_NAMES), MAX_PARAMETERS)
        for index, brdf in enumerate(REGISTRY):
            high[index, : len(brdf.parameters)] = 1.0
        whole = cls(low, high)
        return whole._ending_at(min_width, within=True) if min_width > 0.0 else whole

    def to(self, like: Tensor) -> Feasible:
        """The same bounds as `like [...]` in type and device, so that `project` moves none."""
        gap = None if self.gap is None else self.gap.to(like)
        return Feasible(self.low.to(like), self.high.to(like), gap)

    def _ending_at(self, width: float, *, within: bool) -> Feasible:
        """These bounds with the narrow end of each parameter at a width.

        Args:
            width: of the narrowest lobes.
            within: whether parameters stay within their range.
        """
        low, high = self.low.clone(), self.high.clone()
        for index, brdf in enumerate(REGISTRY):
            for column, row in enumerate(brdf.parameters):
                if row.from_width is not None:
                    value = row.from_width(width)
                    limit = min(max(value, row.low), row.high) if within else value
                    unit = float(row.to_unit(torch.tensor(limit)))
                    (low if row.narrow_is_low else high)[index, column] = unit
        return Feasible(low, high)

    def or_as_narrow_as(self, width: float, models: Sequence[str] = MODEL_NAMES) -> Feasible:
        """These bounds, and lobes exactly `width` wide, which may be narrower than parameters go.

        For peaks that no sample resolves: any width between would be as good to the samples.

        Args:
            width: of the lobes.
            models: that may be so narrow.
        """
        some = torch.tensor([name in models for name in MODEL_NAMES])[:, None].to(self.low.device)
        ends = self._ending_at(width, within=False)
        wider = Feasible(
            torch.where(some, ends.low, self.low), torch.where(some, ends.high, self.high)
        )
        of_high = wider.high > self.high
        start = torch.where(of_high, self.high, wider.low)
        end = torch.where(of_high, wider.high, self.low)
        return replace(wider, gap=torch.stack((start, end)))

    def of(self, model: Tensor) -> Feasible:
        """The bounds of each of the lobes of `model [J]`, for `projected`."""
        gap = None if self.gap is None else self.gap[:, model]
        return Feasible(self.low[model], self.high[model], gap)

    def project(self, model: Tensor, coordinates: Tensor) -> Tensor:
        """The nearest feasible coordinates `[J, COORDINATES]` of lobes of `model [J]`."""
        return self.to(coordinates).of(model).projected(coordinates)

    def projected(self, coordinates: Tensor) -> Tensor:
        """`project` of coordinates `[J, COORDINATES]` of the lobes whose bounds these are."""
        unit = coordinates[:, 3:].clamp(self.low, self.high)
        if self.gap is not None:
            start, end = self.gap
            nearest = torch.where(unit - start < end - unit, start, end)
            unit = torch.where((unit > start) & (unit < end), nearest, unit)
        return torch.cat((project_disk(coordinates[:, :2]), coordinates[:, 2:3], unit), dim=1)
