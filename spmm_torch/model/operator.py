"""The sum over lobes in Eq. 2 as one operator of torch, for compiled programs on a CPU.

By ragged lists, a query evaluates its own lobes alone, where padded tables have several times as
many places; but how long a list is depends on values, so no compiler can follow it.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from .lookup import MergedEntries
from .ragged import by_parts

# Arguments of the operator, and how many of the first have gradients.
_PARTS = (
    "Tensor weight, Tensor kappa, Tensor normal, Tensor angle, Tensor bilinear, Tensor wi, "
    "Tensor wo, Tensor block, Tensor kind, Tensor texel, Tensor start, Tensor count, Tensor lobe, "
    "Tensor entry, Tensor place, float horizon, float lowest"
)
_DIFFERENTIABLE = 7


def lobe_sums(
    merged: MergedEntries,
    lobes: LobeBatch,
    weight: Tensor,
    block: Tensor,
    bilinear: Tensor,
    wi: Tensor,
    wo: Tensor,
) -> Tensor:
    """The sum over lobes of Q queries, `[Q, C]`.

    Args:
        merged: the lobes of all blocks, by their first texel.
        lobes: the dictionary.
        weight: alpha of each entry, `[N, C]`.
        block: first texel of each query, `[Q]`.
        bilinear: weights of its four texels, `[Q, 4]`.
        wi, wo: directions `[Q, 3]`.
    """
    moved = weight, lobes.kappa, lobes.normal, lobes.angle, bilinear, wi, wo
    lists = vars(merged).values()
    return _lobe_sums(*moved, block, lobes.model, *lists, lobes.horizon, lobes.lowest)


def _computed(*given: Any) -> Tensor:
    """`lobe_sums` of the arguments of the operator."""
    weight, kappa, normal, angle, bilinear, wi, wo, block, kind, *lists, horizon, lowest = given
    lobes = LobeBatch(kind, kappa, normal, angle, horizon, lowest)
    blocks = MergedEntries(*lists).weighted(weight.to(torch.promote_types(weight.dtype, wi.dtype)))

    def work(*part: Tensor) -> Tensor:
        return blocks.sums(lobes, *part)

    return by_parts(work, blocks, block, bilinear, wi, wo)


_lobe_sums = torch.library.custom_op(
    "spmm_torch::lobe_sums", _computed, mutates_args=(), schema=f"({_PARTS}) -> Tensor"
)


@_lobe_sums.register_fake
def _(*given: Any) -> Tensor:
    weight, bilinear, wi = given[0], given[4], given[5]
    dtype = torch.promote_types(torch.promote_types(weight.dtype, wi.dtype), bilinear.dtype)
    return wi.new_empty(wi.shape[0], weight.shape[1], dtype=dtype)  # `len` would fix the size


@torch.library.custom_op(
    "spmm_torch::lobe_sums_backward",
    mutates_args=(),
    schema=f"(Tensor slope, bool[] needed, {_PARTS}) -> Tensor[]",
)
def _lobe_sums_backward(slope: Tensor, needed: list[bool], *given: Any) -> list[Tensor]:
    """Gradients of the differentiable arguments that need one, in their order."""
    with torch.inference_mode(False), torch.enable_grad():
        moved = [
            part.detach().clone().requires_grad_(need)
            for part, need in zip(given[:_DIFFERENTIABLE], needed, strict=True)
        ]
        value = _computed(*moved, *given[_DIFFERENTIABLE:])
        live = [part for part in moved if part.requires_grad]
        return list(torch.autograd.grad(value, live, slope, materialize_grads=True))


@_lobe_sums_backward.register_fake
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
    found = iter(_lobe_sums_backward(slope, needed, *given))
    gradients = [next(found) if need else None for need in needed]
    return *gradients, *[None] * (len(given) - _DIFFERENTIABLE)


_lobe_sums.register_autograd(_gradients, setup_context=_kept)
