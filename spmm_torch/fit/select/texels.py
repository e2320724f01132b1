"""Stages select, refit and residual: the sparse fit of every texel of a cluster [WDR11 §4.1].

Everything lives in dictionary space: after the product D^T Y no step passes over the direction
pairs again, and errors follow exactly from the same numbers.
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


@dataclass(frozen=True)
class Products:
    """What the fit needs to know of n texels of a cluster of N; atoms have unit norm.

    Attributes:
        gram: D^T D, `[J, J]`.
        correlation: D^T y, `[n, J, C]`.
        energy: ||y||^2, `[n, C]` float64.
        mean: mean y over the whole cluster, `[D, C]`.
        mean_correlation: D^T mean y, `[J, C]`.
        mean_energy: ||mean y||^2, `[C]` float64.
        count: N, or the sum of the weights of the N texels.
        effective: N, or how many texels of equal weights say as much [Kis65].
        importance: the weights of the n texels, `[n]` float64; None: 1.
        overlap: <y, mean y> summed over channels, `[n]` float64, nearly; None where no residual
            is fit beside the lobes.

    References:
        [Kis65] Kish, Survey Sampling, 1965, section 8.2.
    """

    gram: Tensor
    correlation: Tensor
    energy: Tensor
    mean: Tensor
    mean_correlation: Tensor
    mean_energy: Tensor
    count: float
    effective: float
    importance: Tensor | None = None
    overlap: Tensor | None = None

    def part(self, texels: slice) -> Products:
        """The same of some of the n texels; the cluster stays the same."""
        return replace(
            self,
            correlation=self.correlation[texels].to(self.gram.device),
            energy=self.energy[texels],
            overlap=None if self.overlap is None else self.overlap[texels],
            importance=None if self.importance is None else self.importance[texels],
        )

    def total(self, values: Tensor) -> Tensor:
        """The sum `[]` of values `[n, ...]`, each by the weight of its texel."""
        if self.importance is None:
            return values.sum()
        return (values * self.importance.view(-1, *[1] * (values.dim() - 1))).sum()

    def least_gain(self, share: float) -> float | Tensor:
        """The share of its error that a lobe must take away in a texel, `[n]` where it varies.

        A lobe costs the same in all texels, so where errors count twice, half of it will do.
        """
        return share if self.importance is None else (share / self.importance).clamp(max=1.0)


@dataclass(frozen=True)
class Fit:
    """Sparse weights of the texels of a cluster.

    Attributes:
        index: chosen atoms `[n, M]`, -1 for padding.
        weights: `[n, M, C]` of unit-norm atoms, non-negative.
        solvers: the problems that were solved for it, by solver and status.
    """

    index: Tensor
    weights: Tensor
    solvers: StatusCounts = field(default_factory=StatusCounts.none)

    def total_weights(self, atoms: int, importance: Tensor | None = None) -> Tensor:
        """The sum over the texels, by their `importance [n]`, of every atom: `[J, C]` float64."""
        total = self.weights.new_zeros(atoms, self.weights.shape[2], dtype=torch.float64)
        weights = self.weights.double()
        if importance is not None:
            weights = weights * importance[:, None, None]
        return total.index_add_(0, self.index.clamp(min=0).flatten(), weights.flatten(0, 1))


def select(
    products: Products, target: Target, config: SelectConfig, stagewise: StagewiseConfig
) -> Fit:
    """Chooses the lobes of every texel, a support shared by its channels."""
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


@dataclass(frozen=True)
class Target:
    """What the weights are fit to, in dictionary space: y - share * residual.

    Attributes:
        correlation: D^T target, `[n, J, C]`.
        energy: ||target||^2, `[n, C]`; which channel has how much of it is that of y.
    """

    correlation: Tensor
    energy: Tensor


def target_beside_residual(products: Products, mean: Tensor | None, share: float) -> Target:
    """The target y - share * residual, with the residual that `mean` weights leave the cluster.

    Minimizing ||y - D x||^2 (1 - share) + ||y - D x - residual||^2 share over x is the same as
    fitting D x to it.

    Args:
        products: of the texels.
        mean: weight of every atom, mean over the cluster, `[J, C]`; None: zeros, so that the
            residual is the cluster's mean.
        share: of the residual, 0 to 1; more than 0 needs the overlap of the products.
    """
    if share == 0.0:
        return Target(products.correlation, products.energy)
    if products.overlap is None:
        raise ValueError("products without the overlap of texels and their mean have no residual")
    if mean is None:
        mean = torch.zeros_like(products.mean_correlation)
    mean = mean.to(products.gram.dtype)
    residual = products.mean_correlation - products.gram @ mean  # D^T residual, [J, C]
    of_mean = torch.einsum("njc,jc->n", products.correlation, mean).double()
    along = products.overlap - of_mean  # <y, residual>, [n]
    own = products.mean_energy.sum()
    own = own - ((products.mean_correlation + residual) * mean).sum().double()
    before = products.energy.sum(1)
    energy = (before - 2.0 * share * along + share * share * own).clamp(min=0.0)
    part = torch.where(before > 0.0, energy / before, 0.0)
    return Target(products.correlation - share * residual, products.energy * part[:, None])


def refit(products: Products, fit: Fit, target: Target) -> Fit:
    """Non-negative least squares of each channel on the chosen support [LH74]."""
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
    """What the lobes alone leave of each texel, `[n]` float64, exact in dictionary space."""
    slots = fit.index.clamp(min=0)
    channels = fit.weights.shape[2]
    weights = fit.weights.double()  # zero where padded
    chosen = products.correlation.gather(1, slots[..., None].expand(-1, -1, channels)).double()
    gram = products.gram[slots[:, :, None], slots[:, None, :]].double()
    quadratic = torch.einsum("nac,nab,nbc->n", weights, gram, weights)
    error = products.energy.sum(1) - 2.0 * (weights * chosen).sum((1, 2)) + quadratic
    return error.clamp(min=0.0)


def taken_by_residual(products: Products, mean: Tensor) -> float:
    """How much less the residual leaves of the whole cluster, given its `mean [J, C]` weights."""
    mean = mean.double()
    taken = products.mean_energy.sum() - 2.0 * (mean * products.mean_correlation).sum()
    taken = taken + (mean * (products.gram.double() @ mean)).sum()
    return products.count * max(float(taken), 0.0)


def residual_share(without: float, taken: float, texels: float) -> float:
    """The share of the residual in the target that makes the most of both errors together.

    The sum of both signal-to-noise ratios in dB is stationary where their errors E0 and E1 are
    weighted by 1 / E0 and 1 / E1. E1 is scaled by n / (n - 1): the mean of few texels fits them
    for free, and that of one texel says nothing about it.
    """
    if texels < 2 or without <= 0.0:
        return 0.0
    with_residual = max(without - taken, 0.0) * texels / (texels - 1)
    return without / (without + with_residual)


def _select_stagewise(
    products: Products, target: Target, config: SelectConfig, stagewise: StagewiseConfig
) -> Fit:
    """Stagewise Lasso for every texel and channel, 2 eta threshold, shared support [WDR11 §4.1]."""
    texels, atoms, channels = target.correlation.shape
    norm = target.energy.sqrt().flatten().to(target.correlation.dtype)  # [n C]
    eta = stagewise.eta * norm
    path = stagewise_lasso(
        products.gram,
        target.correlation.transpose(1, 2).reshape(-1, atoms),
        eta=eta,
        lambda_min=stagewise.lambda_min * norm,
        max_steps=stagewise.max_steps,
    )
    weights = lasso_threshold(path.weights, eta).view(texels, channels, atoms)
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
    """Drops lobes without weight, and columns that no texel needs."""
    used = (fit.index >= 0) & (fit.weights > 0.0).any(2)  # [n, M]
    order = torch.argsort((~used).to(torch.int8), dim=1, stable=True)
    slots = int(used.sum(1).max()) if used.numel() else 0
    order = order[:, :slots]
    index = torch.where(used, fit.index, -1).gather(1, order)
    weights = (fit.weights * used[..., None]).gather(
        1, order[..., None].expand(-1, -1, fit.weights.shape[2])
    )
    return Fit(index, weights, fit.solvers)
