"""Stages select and refit: sparse weights of the texels of a cluster, their errors [WDR11 §4.1].

All steps work on the products D^T y: none passes over the direction pairs again, and errors are
exact up to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ...config.fit import SelectConfig, StagewiseConfig
from ...solvers.foba import select_foba
from ...solvers.nnls import nnls_shared_gram
from ...solvers.stagewise_lasso import lasso_threshold, stagewise_lasso
from ...solvers.status import Solver, StatusCounts
from .products import Products
from .target import Target


@dataclass(frozen=True)
class Fit:
    """Sparse weights of the texels of a cluster.

    Attributes:
        index: chosen atoms `[n, M]`, -1 for padding.
        weights: `[n, M, C]` of unit-norm atoms, non-negative.
        solvers: problems solved, by solver and status.
    """

    index: Tensor
    weights: Tensor
    solvers: StatusCounts = field(default_factory=StatusCounts.none)

    def total_weights(self, atom_count: int, importance: Tensor | None = None) -> Tensor:
        """Weights of all atoms `[J, C]` float64, summed over texels times `importance [n]`."""
        total = self.weights.new_zeros(atom_count, self.weights.shape[2], dtype=torch.float64)
        weights = self.weights.double()
        if importance is not None:
            weights = weights * importance[:, None, None]
        return total.index_add_(0, self.index.clamp(min=0).flatten(), weights.flatten(0, 1))


def select(
    products: Products, target: Target, config: SelectConfig, stagewise: StagewiseConfig
) -> Fit:
    """Chooses the atoms of every texel, the same for all its channels, and their weights.

    Args:
        products: of n texels.
        target: what the weights are fit to, `[n, J, C]` in dictionary space.
        config, stagewise: settings of the stage and of the stagewise Lasso.
    """
    if products.gram.shape[0] == 0:
        empty = products.correlation[:, :0]
        return Fit(torch.zeros(empty.shape[:2], dtype=torch.long, device=empty.device), empty)
    if config.method == "stagewise":
        return _select_stagewise(products, target, config, stagewise)
    chosen = select_foba(
        products.gram,
        target.correlation,
        target.energy.sum(1),
        max_lobes=config.max_lobes,
        min_gain=products.least_gain(config.min_gain),
    )
    solvers = StatusCounts.of(Solver.FOBA, chosen.status)
    solvers += StatusCounts.of(Solver.NNLS, chosen.nnls_status)
    return _compact(Fit(chosen.index, chosen.weights.to(products.correlation.dtype), solvers))


def refit(products: Products, fit: Fit, target: Target) -> Fit:
    """Weights of the atoms of `fit` again: NNLS of each channel [LH74], with `target [n, J, C]`."""
    slots = fit.index.clamp(min=0)
    if slots.shape[1] == 0:
        return fit
    gram = products.gram[slots[:, :, None], slots[:, None, :]]  # [n, M, M]
    channels = fit.weights.shape[2]
    rhs = target.correlation.gather(1, slots[..., None].expand(-1, -1, channels))  # [n, M, C]
    solved = nnls_shared_gram(gram, rhs.transpose(1, 2).double(), allowed=fit.index >= 0)
    weights = solved.weights.transpose(1, 2).to(fit.weights.dtype)
    return _compact(Fit(fit.index, weights, StatusCounts.of(Solver.NNLS, solved.status)))


def squared_errors(products: Products, fit: Fit) -> Tensor:
    """Squared error of the lobes alone in each texel, `[n]` float64, from the products."""
    slots = fit.index.clamp(min=0)
    channels = fit.weights.shape[2]
    weights = fit.weights.double()  # zero where padded
    chosen = products.correlation.gather(1, slots[..., None].expand(-1, -1, channels)).double()
    gram = products.gram[slots[:, :, None], slots[:, None, :]].double()
    quadratic = torch.einsum("nac,nab,nbc->n", weights, gram, weights)
    error = products.energy.sum(1) - 2.0 * (weights * chosen).sum((1, 2)) + quadratic
    return error.clamp(min=0.0)


def _select_stagewise(
    products: Products, target: Target, config: SelectConfig, stagewise: StagewiseConfig
) -> Fit:
    """Stagewise Lasso of every texel and channel, thresholded at 2 eta, then refit [WDR11 §4.1].

    All channels of a texel are refit on the union of their atoms.
    """
    texels, atom_count, channels = target.correlation.shape
    norm = target.energy.sqrt().flatten().to(target.correlation.dtype)  # [n C]
    eta = stagewise.eta * norm
    path = stagewise_lasso(
        products.gram,
        target.correlation.transpose(1, 2).reshape(-1, atom_count),
        eta=eta,
        lambda_min=stagewise.lambda_min * norm,
        max_steps=stagewise.max_steps,
    )
    weights = lasso_threshold(path.weights, eta).view(texels, channels, atom_count)
    total = weights.sum(1)  # [n, J]
    most = int((total > 0.0).sum(1).max())
    slots = min(config.max_lobes or most, most)
    value, index = total.topk(slots, dim=1)
    fit = Fit(
        torch.where(value > 0.0, index, -1),
        weights.gather(2, index[:, None].expand(-1, channels, -1)).transpose(1, 2),
    )
    refitted = refit(products, fit, target)
    lasso = StatusCounts.of(Solver.STAGEWISE_LASSO, path.status)
    return replace(refitted, solvers=lasso + refitted.solvers)


def _compact(fit: Fit) -> Fit:
    """Drops atoms without weight, and columns that no texel uses."""
    used = (fit.index >= 0) & (fit.weights > 0.0).any(2)  # [n, M]
    order = torch.argsort((~used).to(torch.int8), dim=1, stable=True)
    slots = int(used.sum(1).max()) if used.numel() else 0
    order = order[:, :slots]
    index = torch.where(used, fit.index, -1).gather(1, order)
    weights = (fit.weights * used[..., None]).gather(
        1, order[..., None].expand(-1, -1, fit.weights.shape[2])
    )
    return Fit(index, weights, fit.solvers)
