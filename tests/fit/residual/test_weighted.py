"""A weight is a repetition: weighted products, choices and errors against repeated data."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.config.fit import FitConfig, SelectConfig, StagewiseConfig
from spmm_torch.data.error_weights import Weights
from spmm_torch.fit.cluster import cluster_texels, sample_texels
from spmm_torch.fit.problem import Problem
from spmm_torch.fit.residual.errors import WeightedErrors
from spmm_torch.fit.residual.missing import MissingPairs
from spmm_torch.fit.select.products import Products, cluster_products
from spmm_torch.fit.select.target import target_beside_residual
from spmm_torch.fit.select.texels import Fit, select
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.model.residual import decode_residual
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.ranks import ALONE
from tests.largest_tensor import LargestTensor
from tests.planted.btfs import random_btf
from tests.planted.directions import random_directions

TEXELS, ATOMS, PAIRS, CHANNELS = 10, 6, 49, 3
DIRECTIONS = ring_directions(((0.0, 1), (45.0, 6)))  # 49 pairs
SUMS = ("gram", "correlation", "energy", "overlap", "mean_correlation", "mean_energy")


def values_of(seed: int = 0) -> tuple[Tensor, Tensor]:
    """Values `[T, D, C]` and lobes `[J, D]`."""
    generator = torch.Generator().manual_seed(seed)
    lobes = torch.rand(ATOMS, PAIRS, generator=generator).square()
    weights = torch.rand(TEXELS, ATOMS, CHANNELS, generator=generator)
    noise = torch.rand(TEXELS, PAIRS, CHANNELS, generator=generator)
    return torch.einsum("tjc,jd->tdc", weights, lobes) + 0.5 * noise, lobes


def whole_numbers(count: int, low: int) -> Tensor:
    generator = torch.Generator().manual_seed(7)
    return torch.randint(low, 4, (count,), generator=generator)


def products_of(values: Tensor, lobes: Tensor, importance: Tensor | None = None) -> Products:
    parts = [slice(0, 4), slice(4, len(values))]
    shape = (len(values), CHANNELS)
    return cluster_products(
        lambda p: values.transpose(1, 2)[p],
        parts,
        shape,
        lobes,
        points=values.flatten(1),
        importance=importance,
    )


def scaled(values: Tensor, lobes: Tensor, pair: Tensor) -> tuple[Tensor, Tensor]:
    root = pair.sqrt()
    return values * root[:, None], lobes * root


def chosen(products: Products, **settings: object) -> Fit:
    target = target_beside_residual(products, None, 0.0)
    return select(products, target, SelectConfig(**settings), StagewiseConfig())


def expand(fit: Fit, lobes: Tensor) -> Tensor:
    """What a fit makes of lobes, `[T, D, C]`."""
    used = lobes[fit.index.clamp(min=0)] * (fit.index >= 0)[..., None]
    return torch.einsum("nmd,nmc->ndc", used, fit.weights)


def test_whole_pair_weights_are_repeated_pairs() -> None:
    values, lobes = values_of()
    times = whole_numbers(PAIRS, 0)
    weighted = products_of(*scaled(values, lobes, times.float()))
    again = torch.repeat_interleave(torch.arange(PAIRS), times)
    repeated = products_of(values[:, again], lobes[:, again])
    for name in SUMS:
        found, expected = (getattr(each, name).float() for each in (weighted, repeated))
        torch.testing.assert_close(found, expected, rtol=2e-6, atol=1e-6)
    first, second = chosen(weighted), chosen(repeated)
    assert torch.equal(first.index, second.index)
    torch.testing.assert_close(first.weights, second.weights, rtol=1e-3, atol=1e-4)


def test_pairs_without_weight_do_not_count() -> None:
    values, lobes = values_of()
    pair = whole_numbers(PAIRS, 0).float()
    other = values.clone()
    other[:, pair == 0.0] = 1e3
    first = chosen(products_of(*scaled(values, lobes, pair)))
    second = chosen(products_of(*scaled(other, lobes, pair)))
    assert torch.equal(first.index, second.index)
    assert torch.equal(first.weights, second.weights)


def test_whole_texel_weights_are_repeated_texels() -> None:
    values, lobes = values_of()
    times = whole_numbers(TEXELS, 1)
    weighted = products_of(values, lobes, times.float())
    repeated = products_of(values[torch.repeat_interleave(torch.arange(TEXELS), times)], lobes)
    assert weighted.count == repeated.count == int(times.sum())
    for name in ("mean", "mean_correlation", "mean_energy"):
        found, expected = (getattr(each, name).float() for each in (weighted, repeated))
        torch.testing.assert_close(found, expected, rtol=2e-6, atol=1e-6)
    assert weighted.total(weighted.energy) == pytest.approx(float(repeated.energy.sum()))
    assert TEXELS * 0.5 < weighted.effective < TEXELS
    assert products_of(values, lobes).effective == TEXELS


def test_heavy_texels_get_lobes_for_less() -> None:
    values, lobes = values_of()
    importance = torch.ones(TEXELS)
    importance[:5], importance[5:] = 10.0, 1e-3
    plain = (chosen(products_of(values, lobes), min_gain=0.3).index >= 0).sum(1)
    fit = chosen(products_of(values, lobes, importance), min_gain=0.3)
    count = (fit.index >= 0).sum(1)
    assert bool((count[:5] >= plain[:5]).all()) and bool((count[:5] > plain[:5]).any())
    assert bool((count[5:] == 0).all())


@pytest.mark.parametrize("weighs", ["pairs", "texels", "both"])
def test_both_errors_are_the_sums_written_out(weighs: str) -> None:
    values, lobes = values_of()
    measured = torch.ones(PAIRS, dtype=torch.bool)
    measured[[5, 20]] = False
    values[:, ~measured] = 0.0
    pair = (whole_numbers(PAIRS, 1).float() if weighs != "texels" else torch.ones(PAIRS)) * measured
    importance = whole_numbers(TEXELS, 1).float() if weighs != "pairs" else None
    v = torch.ones(TEXELS) if importance is None else importance
    products = products_of(*scaled(values, lobes, pair), importance)
    plain = products_of(values, lobes * measured)
    fit = chosen(products)
    mean = fit.total_weights(ATOMS, products.importance) / products.count
    gaps = MissingPairs.build(measured, DIRECTIONS, DIRECTIONS)
    scale = pair.sqrt()
    errors = WeightedErrors(products, scale * lobes, plain, lobes, scale, measured, gaps)
    found = errors.of_fit(mean, [(slice(0, TEXELS), fit)], torch.float16, ALONE)

    left = values - expand(fit, lobes)
    residual = decode_residual(found.code[None], found.scale[None])[0]
    best = (v[:, None, None] * left).sum(0) / v.sum()
    torch.testing.assert_close(residual[measured], best[measured], rtol=1e-2, atol=2e-3)
    after = left - residual
    for totals, w, t in (
        (found.totals, measured.float(), torch.ones(TEXELS)),
        (found.weighted, pair, v),
    ):
        each = w[:, None] * t[:, None, None]
        centre = (t[:, None, None] * values).sum(0) / t.sum()
        for name, error in (
            ("energy", values),
            ("without_residual", left),
            ("with_residual", after),
            ("cluster_mean", values - centre),
        ):
            expected = float((each * error.square()).sum())
            assert getattr(totals, name) == pytest.approx(expected, rel=1e-4), name


def test_texels_without_weight_still_belong_somewhere() -> None:
    btf = random_btf(DIRECTIONS, 4, 5)
    texel = torch.zeros(4, 5)
    texel[1:3] = 1.0
    weights = Weights.build(btf, texel=texel)
    config = FitConfig.from_dict({"cluster": {"count": 6}, "sample": {"per_cluster": 2}})
    problem = Problem.build(btf, weights, config, Context.build("cpu"))
    clusters = cluster_texels(problem)
    assert clusters.points.isfinite().all()
    assert len(torch.cat(clusters.members)) == 20
    heavy = torch.unique(clusters.labels[5:15])
    assert len(heavy) >= 5  # nearly all centres are where errors count
    samples = sample_texels(problem, clusters)
    assert torch.equal(clusters.labels[samples.texels], samples.clusters)


def test_missing_pairs_are_as_their_neighbours() -> None:
    measured = torch.ones(PAIRS, dtype=torch.bool)
    measured[[0, 30]] = False
    gaps = MissingPairs.build(measured, DIRECTIONS, DIRECTIONS)
    light = DIRECTIONS[:, 0].repeat(len(DIRECTIONS))
    smooth = torch.stack((torch.ones(PAIRS), 1.0 + 0.2 * light), dim=1)  # [D, 2]
    values = torch.where(measured[:, None], smooth, -100.0)
    filled = gaps.filled(values)
    assert torch.equal(filled[measured], smooth[measured])
    torch.testing.assert_close(filled[~measured, 0], torch.ones(2))
    assert (filled - smooth)[~measured].abs().max() < 0.1
    assert MissingPairs.of(None, DIRECTIONS, DIRECTIONS) is None


def test_missing_pairs_of_thousands_of_lights_need_no_table_of_their_squares() -> None:
    light = random_directions(3000, seed=1)
    measured = torch.arange(len(light)) % 3 != 0
    with LargestTensor() as largest:
        gaps = MissingPairs.build(measured, light, DIRECTIONS[:1])
    assert largest.numel <= 8 * len(light)
    apart = (light[gaps.pair, None] - light[gaps.neighbour]).norm(dim=2)
    assert torch.equal(apart, apart.sort(dim=1).values)
    assert apart.max() < 0.2
