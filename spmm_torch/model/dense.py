"""Eq. 2 by the same steps for every query: padded tables in place of ragged lists.

What `lookup` sorts and cuts, this evaluates with padding: every texel has as many places for lobes
of a BRDF as the texel with the most. Nothing depends on values or is written in place, so it can be
compiled, exported and transformed by `torch.func`. Run as it stands it takes longer than `lookup`.
Compiled for a CPU too: there `operator` takes its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import torch
from torch import Tensor
from torch._C._functorch import maybe_current_level
from torch._functorch.pyfunctorch import temporarily_clear_interpreter_stack
from torch.autograd import forward_ad
from torch.utils._python_dispatch import _disable_current_modes

from ..brdf import REGISTRY
from ..errors import DataError
from ..geometry.directions import frame_from_normal, texel_at
from ..geometry.relief import HeightField
from ..lobes.batch import LobeBatch
from ..lobes.values import entries, eval_rotated
from . import operator
from .components import Components
from .residual import Residual

if TYPE_CHECKING:
    from .spmm import SPMM

Function = TypeVar("Function", bound=Callable[..., object])


@dataclass(frozen=True)
class Places:
    """The places of all texels for lobes of one BRDF.

    Attributes:
        model: index into `MODEL_NAMES`.
        entry: entry of each place, `[T, M]` int32; N, one past the last, where there is none.
        lobe: its lobe, `[T, M]` int32; any one of the BRDF where there is none.
    """

    model: int
    entry: Tensor
    lobe: Tensor


@dataclass(frozen=True)
class DenseTables:
    """The entries of T texels with padding, BRDF by BRDF: M places a texel in all.

    Attributes:
        groups: of the BRDFs in use.
    """

    groups: tuple[Places, ...]

    @property
    def places(self) -> int:
        """Places of a texel, M."""
        return sum(group.entry.shape[1] for group in self.groups)

    @classmethod
    def build(cls, offset: Tensor, index: Tensor, model: Tensor) -> DenseTables:
        """The tables of entries.

        Args:
            offset: where each texel's entries start, `[T + 1]`.
            index: lobe of each entry, `[N]`.
            model: BRDF of each lobe, `[J]`.
        """
        texels, entries = len(offset) - 1, len(index)
        texel = torch.repeat_interleave(offset[1:] - offset[:-1])  # [N]
        key = texel * len(REGISTRY) + model[index]
        order = torch.argsort(key, stable=True)
        count = torch.bincount(key, minlength=texels * len(REGISTRY))
        rank = torch.arange(entries, device=index.device) - (count.cumsum(0) - count)[key[order]]
        groups = []
        for brdf, most in enumerate(count.view(texels, -1).amax(0).tolist()):
            if most:
                own = model[index[order]] == brdf
                entry = index.new_full((texels, most), entries)
                entry[texel[order[own]], rank[own]] = order[own]
                padding = torch.nonzero(model == brdf)[:1, 0]
                lobe = torch.cat((index, padding))[entry]
                groups.append(Places(brdf, entry.int(), lobe.int()))
        return cls(tuple(groups))


def traced() -> bool:
    """Whether torch records or transforms what is computed: compile, export, vmap, grad, jvp.

    Forward-mode derivatives outside of `torch.func` count: lists have none either.
    """
    if torch.compiler.is_compiling():
        return True
    return maybe_current_level() is not None or forward_ad._current_level >= 0


def taken_as_constant(function: Function) -> Function:
    """Marks a function that torch shall run, and not follow, where it compiles.

    It is `torch.compiler.assume_constant_result`, which loads the whole compiler for that: as much
    time and memory as all else that a command imports.
    """
    function.__dict__["_dynamo_marked_constant"] = True
    return function


@taken_as_constant
def transformed() -> bool:
    """Whether what is computed is transformed: vmap, grad, jvp."""
    return maybe_current_level() is not None


def on_lists(tensor: Tensor) -> bool:
    """Whether a program with a tensor `[...]` is compiled for a CPU: lists are cheaper there.

    Neither an exported program nor a transformed one can have them.
    """
    compiled = torch.compiler.is_compiling() and not torch.compiler.is_exporting()
    return compiled and tensor.is_cpu and not transformed()


def refuse_transforms(name: str) -> None:
    """Refuses a function that `torch.func` cannot follow, as it draws or sorts by values.

    Args:
        name: of the function.

    Raises:
        DataError: what is computed is transformed.
    """
    if transformed():
        raise DataError(
            f"{name} was called under vmap, grad, jacrev or jvp; expected a call outside of them, "
            f"since it sorts by values; give it all queries at once, [..., 2] and [..., 3]."
        )


@contextmanager
def untraced() -> Iterator[None]:
    """Real tensors are computed with as if nothing was recorded or transformed.

    They must be without gradients: `no_grad` would leave a trace that no exported file can hold.
    """
    outside = temporarily_clear_interpreter_stack(), _disable_current_modes()
    with outside[0], outside[1], torch.inference_mode(False):
        yield


def values(
    model: SPMM, uv: Tensor, wi: Tensor, wo: Tensor, *, residual: bool, block: int
) -> Tensor:
    """`SPMM.forward` of Q queries by padded tables, `[Q, C]`.

    There are no matrix products in it, whose precision the program around could lower.

    Args:
        model: the model.
        uv, wi, wo: `[Q, 2]`, `[Q, 3]`, `[Q, 3]`.
        residual: whether to add epsilon.
        block: (query, place) entries that are evaluated at once; all where torch records them.
    """
    if torch.compiler.is_compiling():  # the number of queries stays open
        tables = None if on_lists(uv) else model.padded_tables()
        return _values(model, tables, uv, wi, wo, residual=residual)
    tables = model.padded_tables()
    size = max(1, block // max(1, 4 * tables.places))
    parts = zip(*(part.split(size) for part in (uv, wi, wo)), strict=True)
    return torch.cat([_values(model, tables, *part, residual=residual) for part in parts])


def _values(
    model: SPMM, tables: DenseTables | None, uv: Tensor, wi: Tensor, wo: Tensor, *, residual: bool
) -> Tensor:
    """`values` of one block of queries; without tables, by the operator."""
    uv = model.held(uv)
    if model.relief is not None:
        heights = model.relief.heights(model.texel_count).view(model.height, model.width)
        uv = HeightField(heights, model.rule, model.steepest).hit_of_all(uv, wo)
    texel, bilinear = texel_at(uv, model.height, model.width, model.rule)
    at = texel, bilinear, wi, wo
    if tables is None:
        return operator.values(model, texel[:, 0], bilinear, wi, wo, residual=residual)
    total = lobe_sums(tables, model.dictionary, model.weight, *at)
    if residual:
        total = total + residual_sums(model.residual, model.components, model.labels, *at)
    return total


def lobe_sums(
    tables: DenseTables,
    lobes: LobeBatch,
    weight: Tensor,
    texel: Tensor,
    bilinear: Tensor,
    wi: Tensor,
    wo: Tensor,
) -> Tensor:
    """The sum over lobes in Eq. 2 [WDR11] for Q queries, `[Q, C]`.

    Args:
        tables: of the texture.
        lobes: the dictionary.
        weight: alpha of each entry, `[N, C]`.
        texel, bilinear: four texels of each query and their weights, `[Q, 4]`.
        wi, wo: directions `[Q, 3]`.
    """
    frame = frame_from_normal(lobes.normal, lobes.angle).flatten(1)  # [J, 9]
    table = torch.cat((frame, lobes.kappa), dim=1)  # one lookup of a lobe gives all of it
    padded = torch.cat((weight, weight.new_zeros(1, weight.shape[1])))  # [N + 1, C]
    # Queries last, in memory too: the innermost loop of compiled code then runs over them.
    texel, bilinear = (torch.stack(part.unbind(-1)) for part in (texel, bilinear))  # [4, Q]
    total = bilinear.sum(0)[:, None] * padded.new_zeros(padded.shape[1])  # [Q, C]
    for group in tables.groups:
        place = torch.arange(group.entry.shape[1], device=texel.device)[:, None, None]
        entry, lobe = (part[texel, place].long() for part in (group.entry, group.lobe))
        row = table[lobe]  # [M, 4, Q, 9 + P]
        rotation, kappa = entries(row[..., :9].unflatten(-1, (3, 3))), row[..., 9:]
        ends = lobes.horizon, lobes.lowest
        rho = eval_rotated(group.model, kappa, rotation, wi, wo, *ends) * bilinear
        total = total + (rho[..., None] * padded[entry]).sum((0, 1))
    return total


def residual_sums(
    residual: Residual,
    components: Components | None,
    labels: Tensor,
    texel: Tensor,
    bilinear: Tensor,
    wi: Tensor,
    wo: Tensor,
) -> Tensor:
    """The residual in Eq. 2 of Q queries, `[Q, C]`; see `SPMM.epsilon`.

    Args:
        residual: of the clusters.
        components: of the texels; None for none.
        labels: cluster of each texel, `[T]`.
        texel, bilinear, wi, wo: as in `lobe_sums`.
    """
    pair, weight = residual.pairs.around_all(wi, wo)  # [Q, 9]
    total = weight.new_zeros(1, residual.code.shape[-1])
    if len(residual.code):
        cluster = labels[texel]  # [Q, 4]
        mixed = bilinear * residual.scale.to(weight.dtype)[cluster]
        mixed = mixed[:, :, None] * weight[:, None]  # [Q, 4, 9]
        row = cluster[:, :, None] * residual.code[0, ..., 0].numel() + pair[:, None]
        table = residual.code.flatten(0, 2)  # [K V L, C]
        total = total + (table[row].to(weight.dtype) * mixed[..., None]).sum((1, 2))
    if components is not None:
        total = total + components_sums(components, texel, bilinear, pair, weight)
    return total


def components_sums(
    components: Components, texel: Tensor, bilinear: Tensor, pair: Tensor, weight: Tensor
) -> Tensor:
    """The residual of rank R of Q queries, `[Q, C]`.

    Args:
        components: of the texels.
        texel, bilinear: four texels of each query and their weights, `[Q, 4]`.
        pair, weight: nine measured pairs and their weights, `[Q, 9]`.
    """
    functions, coefficients = components.decoded(weight.dtype)
    bilinear = bilinear.to(weight.dtype)
    value = (functions[pair] * weight[..., None]).sum(1)  # [Q, R C]
    mixed = (coefficients[texel] * bilinear[..., None]).sum(1)  # [Q, R]
    return (mixed[..., None] * value.unflatten(1, (components.rank, -1))).sum(1)
