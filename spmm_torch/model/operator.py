"""Eq. 2 as one operator of torch, for compiled programs on a CPU.

By ragged lists, a query evaluates its own lobes alone, where padded tables have several times as
many places; and part by part, what is computed for a query stays in the cache. But how long a list
is depends on values, so no compiler can follow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from . import components, residual
from .lookup import MergedEntries
from .measured_pairs import MeasuredPairs
from .ragged import by_parts

if TYPE_CHECKING:
    from .spmm import SPMM

# Arguments of the operator, and how many of the first have gradients.
_PARTS = (
    "Tensor weight, Tensor kappa, Tensor normal, Tensor angle, Tensor bilinear, Tensor wi, "
    "Tensor wo, Tensor? code, Tensor? scale, Tensor? functions, Tensor? coefficients, "
    "Tensor? labels, Tensor? light, Tensor? view, Tensor block, Tensor kind, Tensor texel, "
    "Tensor start, Tensor count, Tensor lobe, Tensor entry, Tensor place, float horizon, "
    "float lowest"
)
_DIFFERENTIABLE = 11


@dataclass(frozen=True)
class Epsilon:
    """What the residual of a model is computed of; parts that a model lacks are None.

    Attributes:
        code, scale: of the residual of clusters, `[K, V, L, C]` and `[K]`.
        functions, coefficients: of the components, `[V L, R C]` and `[T, R]`.
        labels: cluster of each texel, `[T]`.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
    """

    code: Tensor | None = None
    scale: Tensor | None = None
    functions: Tensor | None = None
    coefficients: Tensor | None = None
    labels: Tensor | None = None
    light: Tensor | None = None
    view: Tensor | None = None

    @classmethod
    def of(cls, model: SPMM, dtype: torch.dtype) -> Epsilon:
        """The residual of a model, its components as numbers of a type."""
        tables = (None, None) if model.components is None else model.components.decoded(dtype)
        pairs = model.residual.pairs
        clusters = model.residual.code, model.residual.scale
        ends = model.labels, pairs.light.directions, pairs.view.directions
        return cls(*clusters, *tables, *ends)

    def sums(self, texel: Tensor, weight: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Weighted sums `[Q, C]` of the residual of texels `[Q, 4]`; see `SPMM.epsilon`."""
        assert self.code is not None and self.scale is not None and self.labels is not None
        assert self.light is not None and self.view is not None
        near = MeasuredPairs.build(self.light, self.view).around(wi, wo)
        total = residual.blended(self.code, self.scale, self.labels[texel], weight, *near)
        if self.functions is None or self.coefficients is None:
            return total
        return total + components.blended(self.functions, self.coefficients, texel, weight, *near)


def values(
    model: SPMM, block: Tensor, bilinear: Tensor, wi: Tensor, wo: Tensor, *, residual: bool
) -> Tensor:
    """`SPMM.forward` of Q queries, `[Q, C]`.

    Args:
        model: the model.
        block: first texel of each query, `[Q]`.
        bilinear: weights of its four texels, `[Q, 4]`.
        wi, wo: directions `[Q, 3]`.
        residual: whether to add epsilon.
    """
    lobes = model.dictionary
    epsilon = Epsilon.of(model, wi.dtype) if residual else Epsilon()
    moved = model.weight, lobes.kappa, lobes.normal, lobes.angle, bilinear, wi, wo
    lists = vars(model.merged_entries()).values()
    ends = lobes.horizon, lobes.lowest
    return _values(*moved, *vars(epsilon).values(), block, lobes.model, *lists, *ends)


def _computed(*given: Any) -> Tensor:
    """`values` of the arguments of the operator."""
    weight, kappa, normal, angle, bilinear, wi, wo, *rest = given
    epsilon, (block, kind, *lists, horizon, lowest) = Epsilon(*rest[:7]), rest[7:]
    lobes = LobeBatch(kind, kappa, normal, angle, horizon, lowest)
    blocks = MergedEntries(*lists).weighted(weight.to(torch.promote_types(weight.dtype, wi.dtype)))

    def work(block: Tensor, bilinear: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        total = blocks.sums(lobes, block, bilinear, wi, wo)
        if epsilon.code is not None:
            total = total + epsilon.sums(blocks.texel[block], bilinear, wi, wo)  # Eq. (2)
        return total

    return by_parts(work, blocks, block, bilinear, wi, wo)


_values = torch.library.custom_op(
    "spmm_torch::values", _computed, mutates_args=(), schema=f"({_PARTS}) -> Tensor"
)


@_values.register_fake
def _(*given: Any) -> Tensor:
    weight, bilinear, wi = given[0], given[4], given[5]
    dtype = torch.promote_types(torch.promote_types(weight.dtype, wi.dtype), bilinear.dtype)
    return wi.new_empty(wi.shape[0], weight.shape[1], dtype=dtype)  # `len` would fix the size


@torch.library.custom_op(
    "spmm_torch::values_backward",
    mutates_args=(),
    schema=f"(Tensor slope, bool[] needed, {_PARTS}) -> Tensor[]",
)
def _values_backward(slope: Tensor, needed: list[bool], *given: Any) -> list[Tensor]:
    """Gradients of the differentiable arguments that need one, in their order."""
    with torch.inference_mode(False), torch.enable_grad():
        moved = [
            part if part is None else part.detach().clone().requires_grad_(need)
            for part, need in zip(given[:_DIFFERENTIABLE], needed, strict=True)
        ]
        value = _computed(*moved, *given[_DIFFERENTIABLE:])
        live = [part for part in moved if part is not None and part.requires_grad]
        return list(torch.autograd.grad(value, live, slope, materialize_grads=True))


@_values_backward.register_fake
def _(slope: Tensor, needed: list[bool], *given: Any) -> list[Tensor]:
    pairs = zip(given[:_DIFFERENTIABLE], needed, strict=True)
    return [torch.empty_like(part) for part, need in pairs if need]


def _kept(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
    """Keeps what the gradient needs."""
    *tensors, ctx.horizon, ctx.lowest = inputs
    ctx.save_for_backward(*tensors)


def _gradients(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
    """The gradient of every argument of the operator; None of those that need none."""
    needed = list(ctx.needs_input_grad[:_DIFFERENTIABLE])
    given = *ctx.saved_tensors, ctx.horizon, ctx.lowest
    found = iter(_values_backward(slope, needed, *given))
    gradients = [next(found) if need else None for need in needed]
    return *gradients, *[None] * (len(given) - _DIFFERENTIABLE)


_values.register_autograd(_gradients, setup_context=_kept)
