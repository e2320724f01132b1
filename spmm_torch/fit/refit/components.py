"""The residual of rank R that is left beside the lobes: its functions and its coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...model.lookup import SparseWeights
from .lookups import Lookups

# Ridge of the preconditioner, relative to its mean diagonal: functions may vanish in some views.
RIDGE = 1e-4
# Squared gradient, relative to the first one, at which coefficients are as good as their bytes.
CONVERGED = 1e-6


@dataclass(frozen=True)
class Basis:
    """R functions on all pairs, and what they have in common with each other and the lobes.

    Attributes:
        functions: B with the weights of pairs, `[V, R, L, C]`.
        gram: <B_r(v, .), B_s(v, .)>, `[V, R, R]`.
        lobes: <rho_j(v, .), B_r(v, ., c)>, `[V, J, C, R]`.
    """

    functions: Tensor
    gram: Tensor
    lobes: Tensor

    @classmethod
    def build(cls, functions: Tensor, rho: Tensor) -> Basis:
        """The basis of functions `[V, R, L, C]` beside lobes `rho [V, J, L]`."""
        flat = functions.flatten(2)
        lobes = torch.einsum("vjl,vrlc->vjcr", rho, functions)
        return cls(functions, flat @ flat.transpose(1, 2), lobes)


def seen_lobes(entries: SparseWeights, basis: Basis, lookups: Lookups) -> Tensor:
    """Products of the functions with what the lobes show, as seen by the pictures, `[T, R]`."""
    shape = (len(entries.offset) - 1, basis.gram.shape[1])
    total = torch.zeros(shape, dtype=torch.float64, device=entries.weight.device)
    for view in range(lookups.views):
        total += lookups.squared(view, _spread(entries, basis.lobes[view]))
    return total


def seen(coefficient: Tensor, basis: Basis, lookups: Lookups) -> Tensor:
    """The normal matrix of the coefficients times `coefficient [T, R]`."""
    total = torch.zeros_like(coefficient)
    for view in range(lookups.views):
        total += lookups.squared(view, coefficient @ basis.gram[view])
    return total


def coefficients(rhs: Tensor, basis: Basis, lookups: Lookups, steps: int) -> Tensor:
    """Coefficients `[T, R]` of the functions, by conjugate gradients.

    Args:
        rhs: products of the functions with what the lobes leave of the pictures, `[T, R]`.
        basis: the functions.
        lookups: what each pixel shows.
        steps: most products with the normal matrix.
    """
    share = lookups.weight.square().sum((1, 2)) / lookups.weight.shape[1]  # [V]
    mean = torch.einsum("v,vrs->rs", share, basis.gram)
    ridge = RIDGE * mean.diagonal().mean().clamp(min=torch.finfo(mean.dtype).tiny)
    inverse = torch.linalg.inv((mean + ridge * torch.eye(len(mean)).to(mean)).double()).to(mean)
    rhs = rhs.to(mean)
    found, left = torch.zeros_like(rhs), rhs
    step = left @ inverse
    size = first = (left * step).sum()
    tiny = torch.finfo(size.dtype).tiny
    for _ in range(steps):
        if not bool(size > CONVERGED * first):
            break
        along = seen(step, basis, lookups)
        reach = size / (step * along).sum().clamp(min=tiny)
        found = found + reach * step
        left = left - reach * along
        scaled = left @ inverse
        before, size = size, (left * scaled).sum()
        step = scaled + (size / before) * step
    return found


def _spread(entries: SparseWeights, lobes: Tensor) -> Tensor:
    """Sum of alpha * lobes[j, c] over lobes and channels, `[T, R]`, given `lobes [J, C, R]`."""
    count = entries.offset[1:] - entries.offset[:-1]
    texel = torch.repeat_interleave(count)
    value = torch.einsum("nc,ncr->nr", entries.weight, lobes[entries.index])
    return value.new_zeros(len(count), value.shape[1]).index_add_(0, texel, value)
