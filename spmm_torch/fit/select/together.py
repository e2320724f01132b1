"""Stages select and residual on a GPU: the texels of all clusters choose at once.

Without a residual beside the lobes the texels of all clusters are problems of one Gram matrix, but
for the lobes that are open to each. Cluster by cluster a GPU would be asked for thousands of small
operations; here their number does not depend on that of clusters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from ...data.blocks import block_texels
from ...metrics import Totals
from ...model.residual import decode_residual, encode_residual
from ...runtime.memory import slices
from ...solvers.status import StatusCounts
from ..cluster import Clusters
from ..dictionary import Dictionary
from ..problem import Problem
from ..residual.exact import exact_where_doubtful
from .alternate import CUDA_TEXELS
from .clusters import PILOTS, PRECISIONS, ClusterFit, fit_texels, joined, pilot_of
from .products import Products, correlations, squared_norms
from .target import Target
from .texels import Fit, select, squared_errors

# Correlation of lobes that are closed to a texel: no other one is so low, and 0 times it is 0.
CLOSED = -1e30


def fit_clusters(problem: Problem, clusters: Clusters, dictionary: Dictionary) -> list[ClusterFit]:
    """`fit_texels`, of all clusters at once where that is possible and the device is a GPU."""
    if not _is_apart(problem, dictionary):
        return fit_texels(problem, clusters, dictionary)
    context, found = problem.context, list[ClusterFit]()

    def fit_of(cluster: int) -> ClusterFit:
        if not found:
            found.extend(_fit_all(problem, clusters, dictionary))
        return found[cluster]

    fits = []
    with context.progress.stage("select", problem.btf.texel_count, "texels") as advance:
        for cluster, members in enumerate(clusters.members):
            name = f"texels-{cluster:04d}"
            fits.append(context.once(name, ClusterFit, lambda cluster=cluster: fit_of(cluster)))
            advance(len(members))
    return fits


def _is_apart(problem: Problem, dictionary: Dictionary) -> bool:
    """Whether texels are problems of their own, on a GPU."""
    config = problem.config
    return (
        dictionary.atoms.is_cuda
        and len(dictionary.atoms) > 0
        and problem.context.ranks.size == 1
        and problem.weights.uniform
        and not config.residual.beside_lobes
        and config.select.method != "stagewise"
    )


@dataclass(frozen=True)
class _Choice:
    """What n texels chose, and sums over those of each cluster.

    Attributes:
        fit: of the texels, with weights of unit-norm atoms.
        error: squared error of the lobes, by cluster, `[K]` float64.
        energy: sum of squares, `[K]` float64.
        values: sum of the values, `[K, C, D]` float64.
        weights: sum of the weights, `[K, J, C]` float64.
    """

    fit: Fit
    error: Tensor
    energy: Tensor
    values: Tensor
    weights: Tensor


def _fit_all(problem: Problem, clusters: Clusters, dictionary: Dictionary) -> list[ClusterFit]:
    """The fits of all clusters."""
    context, sizes = problem.context, [len(members) for members in clusters.members]
    texels = torch.cat(clusters.members)
    owner = torch.arange(len(sizes)).repeat_interleave(torch.tensor(sizes))
    with context.watch("select"):
        allowed, pilots = _open_lobes(problem, clusters, dictionary)
        chosen = _choose(problem, dictionary.atoms, texels, owner, allowed)
    with context.watch("residual"):
        count = torch.tensor(sizes, dtype=torch.float64).to(problem.device)
        code, scale, totals = _residuals(problem, dictionary.atoms, chosen, count)
        totals = _exact(problem, clusters, dictionary.atoms, chosen, (code, scale), totals)
    index, norm = chosen.fit.index, dictionary.norm[chosen.fit.index.clamp(min=0)]
    weights = (chosen.fit.weights / norm[..., None]).cpu().split(sizes)
    parts = (index.cpu().split(sizes), weights, code.cpu().unbind(), scale.cpu().unbind())
    fits = [ClusterFit(*part) for part in zip(*parts, totals, strict=True)]
    counts = (pilots + chosen.fit.solvers).to("cpu")
    return [replace(fits[0], solvers=counts), *fits[1:]]


def _open_lobes(
    problem: Problem, clusters: Clusters, dictionary: Dictionary
) -> tuple[Tensor | None, StatusCounts]:
    """Lobes that are open to each cluster, `[K, J]` bool, None: all; and the problems solved.

    Those of the dictionary, and in a large cluster those of them that some of its texels choose.
    """
    atoms, size = dictionary.atoms, problem.config.select.pilot
    large = [
        cluster
        for cluster, members in enumerate(clusters.members)
        if size is not None and len(members) > PILOTS * size
    ]
    shared = dictionary.is_shared
    if shared and not large:
        return None, StatusCounts.none()
    allowed = torch.zeros(len(clusters.members), len(atoms), dtype=torch.bool)
    for own, choice in zip(allowed, dictionary.choices, strict=True):
        own[slice(None) if shared else choice.cpu()] = True
    allowed = allowed.to(atoms.device)
    if not large or size is None:
        return allowed, StatusCounts.none()
    some = [
        pilot_of(problem.context.generator(f"pilot-{cluster}"), clusters.members[cluster], size)
        for cluster in large
    ]
    owner = torch.tensor(large).repeat_interleave(size)
    found = _choose(problem, atoms, torch.cat(some), owner, None if shared else allowed)
    place = torch.tensor(large).to(atoms.device)
    allowed[place] &= (found.weights[place] > 0.0).any(2)
    return allowed, found.fit.solvers


def _choose(
    problem: Problem, atoms: Tensor, texels: Tensor, owner: Tensor, allowed: Tensor | None
) -> _Choice:
    """The choice of `texels [n]` of the clusters `owner [n]`, ascending, from lobes `allowed`."""
    device, config = problem.device, problem.config
    gram, clusters = atoms @ atoms.T, int(owner[-1]) + 1
    owner = owner.to(device)
    member = one_hot(owner, clusters).to(atoms.dtype)  # [n, K]
    fits, errors, energies = [], [], []
    values = torch.zeros(clusters, problem.btf.channels, atoms.shape[1], device=device).double()
    for part in slices(len(texels), min(block_texels(problem.btf, device), CUDA_TEXELS)):
        signals = problem.signals(texels[part])  # [m, C, D]
        products = _of_block(gram, correlations(atoms, signals), squared_norms(signals))
        correlation = products.correlation
        if allowed is not None:
            correlation = closed(correlation, allowed[owner[part]])
        target = Target(correlation, products.energy)
        fits.append(select(products, target, config.select, config.stagewise))
        errors.append(squared_errors(products, fits[-1]))
        energies.append(products.energy.sum(1))
        values += (member[part].T @ signals.flatten(1)).view(values.shape)
    index, weights = joined([(each.index, each.weights) for each in fits])
    fit = Fit(index, weights, StatusCounts.sum(each.solvers for each in fits))
    sums = torch.stack((torch.cat(errors), torch.cat(energies)), dim=1)  # [n, 2]
    error, energy = (member.double().T @ sums).unbind(1)
    return _Choice(fit, error, energy, values, _weights_of(fit, owner, clusters, len(atoms)))


def closed(correlation: Tensor, allowed: Tensor) -> Tensor:
    """Products D^T y `[n, J, C]` of which no texel chooses lobes that are not `allowed [n, J]`."""
    return torch.where(allowed[..., None], correlation, CLOSED)


def _of_block(gram: Tensor, correlation: Tensor, energy: Tensor) -> Products:
    """The products of some texels, of whose clusters nothing is known yet."""
    none = gram.new_zeros(0)
    return Products(gram, correlation, energy, none, none, none, len(energy), len(energy))


def _weights_of(fit: Fit, owner: Tensor, clusters: int, atoms: int) -> Tensor:
    """Weights of all atoms, summed over the texels of each cluster, `[K, J, C]` float64."""
    place = owner[:, None] * atoms + fit.index.clamp(min=0)  # [n, M]; padding has no weight
    total = fit.weights.new_zeros(clusters * atoms, fit.weights.shape[2], dtype=torch.float64)
    total.index_add_(0, place.flatten(), fit.weights.double().flatten(0, 1))
    return total.view(clusters, atoms, -1)


def _residuals(
    problem: Problem, atoms: Tensor, chosen: _Choice, count: Tensor
) -> tuple[Tensor, Tensor, list[Totals]]:
    """Stored residuals `[K, D, C]`, their scales `[K]`, and the errors of all clusters.

    As `uniform_errors` has them for one cluster of `count [K]` texels.
    """
    mean = (chosen.values / count[:, None, None]).transpose(1, 2)  # [K, D, C]
    weight = chosen.weights / count[:, None, None]  # [K, J, C]
    shown = atoms.double()  # [J, D]
    residual = mean - shown.T @ weight
    # What the residual takes away is n times its squared norm.
    taken = count * residual.square().sum((1, 2))
    precision = PRECISIONS[problem.config.residual.precision]
    code, scale = encode_residual(residual.float(), precision)
    rounding = (decode_residual(code, scale).double() - residual).square().sum((1, 2))
    of_mean = chosen.energy - count * mean.square().sum((1, 2))
    whole = (chosen.error - taken).clamp(min=0.0) + count * rounding
    rows = torch.stack((chosen.energy, chosen.error, whole, of_mean), dim=1).tolist()
    return code, scale, [Totals(*row) for row in rows]


def _exact(
    problem: Problem,
    clusters: Clusters,
    atoms: Tensor,
    chosen: _Choice,
    stored: tuple[Tensor, Tensor],
    totals: list[Totals],
) -> list[Totals]:
    """The errors of all clusters, by one more pass where they may be rounding."""
    sizes = [len(members) for members in clusters.members]
    fits = zip(chosen.fit.index.split(sizes), chosen.fit.weights.split(sizes), strict=True)
    exact = []
    for cluster, (own, fit) in enumerate(zip(totals, fits, strict=True)):
        members = clusters.members[cluster]

        def load(part: slice, members: Tensor = members) -> Tensor:
            return problem.signals(members[part])

        parts = list(slices(len(members), block_texels(problem.btf, problem.device)))
        code, scale = (part[cluster : cluster + 1] for part in stored)
        residual = decode_residual(code, scale)[0]
        exact.append(exact_where_doubtful(own, (load, parts), [Fit(*fit)], atoms, residual))
    return exact
