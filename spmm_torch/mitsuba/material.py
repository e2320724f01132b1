"""A fitted model in the arrays of a variant: what the plug-in `spmm` evaluates and samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..errors import DataError
from ..model.components import Components
from ..model.spmm import SPMM
from . import mixture, tables
from .arrays import SMALLEST, drawn, index_array, is_jit, tensor
from .hemisphere import Around, Mesh, Pairs
from .libraries import dr, mi
from .lobe import Lobes
from .ray_walk import Walk
from .residual import ByteResidual, Clusters, RankResidual, Residual, epsilon
from .texels import block_at, block_corners, texel_drawn

# Parameters that the sampler follows through the model in torch.
OF_LOBES = ("weight", "kappa", "normal", "angle")

# How texels are looked up between their centres.
BILINEAR, STOCHASTIC = "bilinear", "stochastic"
FILTERS = (BILINEAR, STOCHASTIC)


@dataclass(frozen=True)
class Seen:
    """What a view shows at a place.

    Attributes:
        place: a block of texels, and their weights.
        wo: the view as it is shown.
        chances: the probabilities with which lobes are sampled.
        views: the measured views around it, and their weights.
    """

    place: mixture.Place
    wo: Any
    chances: mixture.Shares
    views: Around


class Material:
    """The tables of a model, made anew when its parameters change.

    Attributes:
        model: the model in torch; `synchronize` gives it the numbers of the parameters.
        parameters: tensors of the variant by name, with gradients where these are enabled.
    """

    def __init__(self, model: SPMM, texels: str = BILINEAR) -> None:
        if model.weight.shape[1] not in (1, 3):
            raise DataError(
                f"the model {model.name!r} has {model.weight.shape[1]} channels; expected 1 or 3, "
                f"which a picture in RGB can show; fit it again from such data."
            )
        self.model = model
        self.parameters = {name: tensor(value) for name, value in _numbers(model).items()}
        corners = torch.arange(model.texel_count)[:, None]
        if texels == BILINEAR:
            corners = block_corners(model.height, model.width, model.rule)
        self._filter = texels
        self._corners = corners
        self._merged = tables.Merged.build(corners, model)
        pairs = model.residual.pairs
        self._light, self._view = Mesh.build(pairs.light), Mesh.build(pairs.view)
        self._lowest = pairs.lowest_light
        self._labels = index_array(model.labels[corners])
        self._corner_array = index_array(corners)
        self._residual_rows = tables.cluster_rows(model) if len(model.residual.code) else None
        if model.components is not None:
            self._function_rows = tables.function_rows(model.components)
            self._coefficient_rows = tables.coefficient_rows(model.components, model.texel_count)
        self._walk = None
        if model.relief is not None:
            field = model.relief.field(model.height, model.width, model.view)
            self._walk = Walk.build(field)
        uneven = model.relief is not None and bool(model.relief.height.any())
        self._lowest_view = model.lowest_view if uneven else 0.0
        self._build()

    def update(self, names: Iterable[str] = ()) -> None:
        """Makes the tables of parameters that have changed.

        Args:
            names: of these parameters; none: all.
        """
        self.synchronize(names)
        self._build()

    @torch.no_grad()
    def synchronize(self, names: Iterable[str] = ()) -> SPMM:
        """The model in torch with the present numbers of the parameters.

        Args:
            names: of the parameters that are taken; none: all.
        """
        model = self.model
        for name in names or self.parameters:
            value = _in_torch(self.parameters[name])
            if name in OF_LOBES:
                getattr(model, name).copy_(value)
            elif name == "residual":
                model.residual = model.residual.with_codes(value, torch.ones(len(value)))
            elif model.components is not None and name == "functions":
                ones = torch.ones(value.shape[:2])
                model.components = model.components.with_codes(code=value, scale=ones)
            elif model.components is not None:
                ones = torch.ones(value.shape[1])
                model.components = model.components.with_codes(
                    coefficient=value, coefficient_scale=ones
                )
        return model

    def seen(self, uv: Any, wo: Any) -> Seen:
        """What the view wo shows at uv of the plane; v runs up."""
        held = self._held(wo)
        place = self._place(uv, held)
        chances = mixture.shares(self._sampled, self._specular, self._group, place, dr.detach(held))
        return Seen(place, held, chances, self._view.around(held))

    def evaluated(self, seen: Seen, wi: Any) -> tuple[Any, Any]:
        """(cosine-weighted RGB [WDR11 Eq. 2], density of `sample` in 1/sr) at wi.

        Both are 0 under the horizon.
        """
        total, density = mixture.evaluated(
            self._lobes, self._entries, self._weights, seen.place, seen.chances, wi, seen.wo
        )
        if not self._residuals:
            return total, density
        fade = dr.select(seen.wo.z > 0.0, dr.clip(wi.z / self._lowest, 0.0, 1.0), 0.0)
        pairs = Pairs.build(self._light.count, self._light.around(wi), seen.views, fade)
        return total + epsilon(self._residuals, *seen.place, pairs), density

    def sample(self, seen: Seen, u: Sequence[Any]) -> Any:
        """wi in the upper hemisphere of three numbers u in [0, 1)."""
        wo = dr.detach(seen.wo)
        return mixture.sample(self._sampled, self._specular, seen.place[0], seen.chances, wo, u)

    def _place(self, uv: Any, wo: Any) -> mixture.Place:
        """(block, weights of its texels) that the view wo shows at uv of the plane."""
        at = uv if self._walk is None else self._walk.hit(uv, wo)
        shape = self.model.height, self.model.width, self.model.rule
        if self._filter == BILINEAR:
            return block_at(at, *shape)
        return texel_drawn(at, *shape, drawn(uv.x, uv.y, wo.x, wo.y)), [mi.Float(1.0)]

    def _held(self, wo: Any) -> Any:
        """The view as it is shown: the twin of `geometry.grazing.held_view`."""
        if self._lowest_view == 0.0:
            return wo
        low = (wo.z > 0.0) & (wo.z < self._lowest_view)
        length = dr.sqrt(dr.maximum(wo.x * wo.x + wo.y * wo.y, SMALLEST))
        planar = math.sqrt(1.0 - self._lowest_view**2) / length
        turned = mi.Vector3f(planar * wo.x, planar * wo.y, self._lowest_view)
        return dr.select(low, turned, wo)

    def _build(self) -> None:
        """The tables of the present parameters."""
        model, parameters, data = self.model, self.parameters, self.model.sampling_data()
        twins = tables.twins_in_use(model)
        kinds = index_array(tables.kind_of_lobes(model)), twins
        table, ends = tables.lobe_table(model, parameters), (model.horizon, model.lowest_light)
        self._lobes, self._sampled = (
            Lobes(table, *kinds, *ends),
            Lobes(dr.detach(table), *kinds, *ends),
        )
        specular = tables.specular_blocks(self._corners, data)
        self._entries, rows = tables.all_entries(self._merged, specular, len(twins))
        self._weights = rows.of(parameters["weight"])
        self._specular = tables.specular_entries(specular)
        self._group = tables.group_codes(self._corners, data)
        self._residuals = self._residual_kinds()

    def _residual_kinds(self) -> list[Residual]:
        """The residuals of the model."""
        kinds: list[Residual] = []
        if self._residual_rows is not None:
            values = self._residual_rows.of(self.parameters["residual"])
            pairs = self._light.count * self._view.count
            kinds.append(Clusters(values, self._labels, pairs))
        if self.model.components is not None:
            kinds.append(self._rank_residual(self.model.components))
        return kinds

    def _rank_residual(self, components: Components) -> RankResidual:
        """The residual of rank R, of bytes as far as its functions are those of a file."""
        functions = self.parameters["functions"]
        coefficients = self._coefficient_rows.of(self.parameters["coefficients"])
        rank, width = tables.padded_rank(components), tables.width_of(components)
        common = coefficients, self._corner_array, rank, width
        if is_jit() and components.code.dtype == torch.int8 and not dr.grad_enabled(functions):
            words, scales, count = tables.byte_words(components)
            return ByteResidual(words, *common, scales, count)
        return RankResidual(self._function_rows.of(functions), *common)


@torch.no_grad()
def _numbers(model: SPMM) -> dict[str, Tensor]:
    """The numbers that a model is made of, by name, without scales."""
    numbers = {name: getattr(model, name) for name in OF_LOBES}
    residual, components = model.residual, model.components
    if len(residual.code):
        numbers["residual"] = residual.code.float() * residual.scale.view(-1, 1, 1, 1)
    if components is not None:
        numbers["functions"] = components.code.float() * components.scale[..., None, None]
        numbers["coefficients"] = components.coefficients()
    return numbers


def _in_torch(values: Any) -> Tensor:
    """A tensor of the variant in torch."""
    return torch.from_numpy(np.array(dr.detach(values), dtype=np.float32))
