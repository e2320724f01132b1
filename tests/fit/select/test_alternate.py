"""The fit of one cluster beside its residual."""

from __future__ import annotations

from dataclasses import replace

import torch

from spmm_torch import FitConfig
from spmm_torch.fit.select.alternate import ClusterProblem
from spmm_torch.fit.select.products import cluster_products
from spmm_torch.runtime.context import Context

ATOMS, USED, PAIRS, CHANNELS = 7, 4, 60, 3


def problem(texels: int, noise: float) -> ClusterProblem:
    """Mixtures of some atoms, and noise; texels are their own coordinates."""
    generator = torch.Generator().manual_seed(0)
    atoms = torch.rand(ATOMS, PAIRS, generator=generator)
    atoms = atoms / atoms.norm(dim=1, keepdim=True)
    values = torch.rand(texels, CHANNELS, USED, generator=generator) @ atoms[:USED]
    values += noise * torch.rand(texels, CHANNELS, PAIRS, generator=generator)
    products = cluster_products(
        lambda part: values[part],
        [slice(0, texels)],
        (texels, CHANNELS),
        atoms,
        points=values.flatten(1),
    )
    return ClusterProblem(products, FitConfig(), Context.build("cpu"))


def test_rounding_does_not_cost_a_texel_its_lobes() -> None:
    """A texel alone in its cluster is its own mean, so fitting around that mean leaves no lobes.

    One of the measured BRDFs lost all of them by a rounding error of 1.3e-6 of its energy.
    """
    exact = problem(1, 1.0)
    products = exact.products
    rounded = replace(products, mean_correlation=products.mean_correlation * (1.0 + 1e-6))
    energy = float(products.energy.sum())
    solution = replace(exact, products=rounded).solve()
    assert solution.error - solution.taken > 1.3e-6 * energy  # rounding shows
    assert len(solution.fits) == 1 and solution.fits[0].index.shape[1] > 0
    assert solution.error < 0.5 * energy


def test_a_pilot_of_all_texels_tells_what_the_whole_fit_finds_itself() -> None:
    """Its start leads to the same weights, and its atoms are those of the lobes alone."""
    whole = problem(20, 1e-4)
    start, needed, solved = whole.pilot()
    found, expected = whole.solve(start), whole.solve()
    assert 0.0 < start.weight < 1.0
    for mine, theirs in zip(found.fits, expected.fits, strict=True):
        assert torch.equal(mine.index, theirs.index) and torch.equal(mine.weights, theirs.weights)
    residual = replace(whole.config.residual, joint=False)
    alone = replace(whole, config=replace(whole.config, residual=residual)).solve()
    index = torch.cat([fit.index.flatten() for fit in alone.fits])
    assert torch.equal(needed.nonzero()[:, 0], index[index >= 0].unique())
    assert 0 < int(needed.sum()) < ATOMS
