"""The residual of rank R that is left beside the lobes: its functions and its coefficients."""

from __future__ import annotations

import torch
from torch import Tensor

from ...model.lookup import SparseWeights
from ...runtime.device import asks
from ...runtime.sparse import sparse_product
from .lookups import Lookups
from .matrices import joint_matrix, products_at, rows_by_view, side_by_side

# Ridge of the preconditioner, relative to its mean diagonal: functions may vanish in some views.
RIDGE = 1e-4
# Squared gradient, relative to that of zeros, at which coefficients are as good as their bytes.
CONVERGED = 1e-5
# Steps after which a GPU is asked whether that is reached: the host waits to know it.
CUDA_STEPS = 4


def first_coefficients(
    points: Tensor, functions: Tensor, entries: SparseWeights, rho: Tensor, rank: int
) -> Tensor:
    """First coefficients `[T, R]`: the leading left singular vectors of what the lobes leave.

    Args:
        points: principal coordinates of the aligned values, `[T, P]`.
        functions: of these coordinates, `[D, P, C]`.
        entries: fit of all texels.
        rho: values of the lobes, `[J, D]`; weighted, as the functions are.
        rank: R.
    """
    lobes = torch.einsum("jd,dpc->jcp", rho, functions)
    shown = sparse_product(joint_matrix(entries, len(lobes)), lobes.flatten(0, 1))  # [T, P]
    left = points.double() - shown.double()
    return torch.linalg.svd(left, full_matrices=False).U[:, :rank].to(points.dtype)


def gram_by_view(functions: Tensor, scale: Tensor | None) -> Tensor:
    """<B_r(v, .), B_s(v, .)>, `[V, R, R]`.

    Args:
        functions: B without the weights of pairs, `[V, R, L, C]`.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
    """
    if scale is not None:
        functions = functions * scale.view(len(functions), 1, -1, 1)
    flat = functions.flatten(2)
    return flat @ flat.transpose(1, 2)


def seen(coefficient: Tensor, gram: Tensor, lookups: Lookups) -> Tensor:
    """The normal matrix of the coefficients times `coefficient [T, R]`."""
    total = torch.zeros_like(coefficient)
    for run in lookups.runs():
        total += lookups.squared(run, rows_by_view(coefficient @ side_by_side(gram[run]), run))
    return total


def coefficients(
    rhs: Tensor, gram: Tensor, lookups: Lookups, steps: int, start: Tensor | None = None
) -> Tensor:
    """Coefficients `[T, R]` of the functions, by conjugate gradients.

    Args:
        rhs: products of the functions with what the lobes leave of the pictures, `[T, R]`.
        gram: products of the functions with each other, `[V, R, R]`; see `gram_by_view`.
        lookups: what each pixel shows.
        steps: most products with the normal matrix.
        start: first coefficients, `[T, R]`; None: zeros.
    """
    share = lookups.weight.square().sum((1, 2)) / lookups.weight.shape[1]  # [V]
    mean = torch.einsum("v,vrs->rs", share, gram)
    ridge = (RIDGE * mean.diagonal().mean()).clamp(min=torch.finfo(mean.dtype).tiny)
    inverse = torch.linalg.inv((mean + ridge * torch.eye(len(mean)).to(mean)).double()).to(mean)
    rhs = rhs.to(mean)
    first = (rhs * (rhs @ inverse)).sum()
    found = torch.zeros_like(rhs) if start is None else start
    left = rhs if start is None else rhs - seen(start, gram, lookups)
    step = left @ inverse
    size = (left * step).sum()
    tiny = torch.finfo(size.dtype).tiny
    for number in range(steps):
        if asks(size, number, CUDA_STEPS) and not bool(size > CONVERGED * first):
            break
        along = seen(step, gram, lookups)
        reach = size / (step * along).sum().clamp(min=tiny)
        found = torch.addcmul(found, reach, step)
        left = torch.addcmul(left, reach, along, value=-1.0)
        scaled = left @ inverse
        before, size = size, (left * scaled).sum()
        step = torch.addcmul(scaled, size / before.clamp(min=tiny), step)
    return found


def lobe_kernel(functions: Tensor, rho: Tensor, scale: Tensor | None) -> Tensor:
    """<rho_j(v, .), B_r(v, ., c)>, `[V, J, C, R]`.

    Args:
        functions: B without the weights of pairs, `[V, R, L, C]`.
        rho: values of the lobes, `[V, J, L]`.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
    """
    if scale is not None:
        rho = rho * scale.view(len(rho), 1, -1).square()
    return torch.einsum("vjl,vrlc->vjcr", rho, functions)


def seen_by_lobes(
    coefficient: Tensor, kernel: Tensor, lookups: Lookups, entries: SparseWeights
) -> Tensor:
    """Products of each entry with what the components show, `[N, C]` float64.

    Args:
        coefficient: c, `[T, R]`.
        kernel: see `lobe_kernel`.
        lookups: what each pixel shows.
        entries: lobes of all texels; weights are not read.
    """
    pattern = joint_matrix(entries, kernel.shape[1])
    total = torch.zeros(entries.weight.numel(), dtype=torch.float64, device=kernel.device)
    for run in lookups.runs():
        shared = kernel[run].flatten(1, 2).transpose(1, 2).flatten(0, 1)  # [n R, J C]
        shown = side_by_side(lookups.squared_apart(run, coefficient))  # [T, n R]
        total += products_at(pattern, shown, shared.contiguous())
    return total.view(entries.weight.shape)


def seen_by_components(entries: SparseWeights, kernel: Tensor, lookups: Lookups) -> Tensor:
    """Products of each texel's functions with what the lobes show, `[T, R]` float64."""
    weights = joint_matrix(entries, kernel.shape[1])
    shape = (len(entries.offset) - 1, kernel.shape[3])
    total = torch.zeros(shape, dtype=torch.float64, device=kernel.device)
    for run in lookups.runs():
        shown = sparse_product(weights, side_by_side(kernel[run].flatten(1, 2)))  # [T, n R]
        total += lookups.squared(run, rows_by_view(shown, run))
    return total
