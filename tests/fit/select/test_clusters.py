"""All clusters: several at once on a CPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from typing import Any

import pytest
import torch

from spmm_torch import FitConfig
from spmm_torch.data import Selection, load_btf, sample_path
from spmm_torch.data.error_weights import UNIFORM
from spmm_torch.fit.cluster import Clusters
from spmm_torch.fit.dictionary import Dictionary
from spmm_torch.fit.problem import Problem
from spmm_torch.fit.select import clusters as module
from spmm_torch.fit.select import together
from spmm_torch.fit.select.clusters import ClusterFit, SelectStage, cluster_bytes, fit_texels
from spmm_torch.fit.select.products import Products
from spmm_torch.geometry.directions import hemisphere_spiral
from spmm_torch.lobes.grid import DirectionGrid
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Progress
from spmm_torch.runtime.stopwatch import Stopwatch
from spmm_torch.runtime.threads import cpu_threads
from tests.planted.lobes import Lobe, lobe_batch
from tests.planted.settings import FLAT

CPU = torch.device("cpu")
CLUSTERS, LOBES = 5, 20


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    with cpu_threads(2):
        yield


@pytest.fixture(scope="module")
def stage() -> SelectStage:
    btf = load_btf(sample_path(), selection=Selection(texels=100, directions="0,30,60")).load()
    lobes = lobe_batch(*[Lobe("blinn_phong", (8.0,))] * LOBES)
    lobes = replace(lobes, normal=hemisphere_spiral(LOBES))
    raw = DirectionGrid.build(btf.light, btf.view, CPU).eval(lobes)
    norm = raw.norm(dim=1)
    atoms = raw / norm[:, None]
    choices = [torch.arange(LOBES)] * CLUSTERS
    dictionary = Dictionary(lobes, atoms, norm, choices, raw)
    config = FitConfig.from_dict({**FLAT, "select": {"pilot": 4}})
    problem = Problem.build(btf, UNIFORM, config, Context.build("cpu", memory=1 << 30))
    return SelectStage(problem, btf.texels().flatten(1), dictionary, 1 << 30)


def fits(stage: SelectStage, spare: int, watch: Stopwatch) -> list[ClusterFit]:
    """The fits of five clusters of 20 texels, with so much memory to spare."""
    labels = torch.arange(stage.problem.btf.texel_count) // 20
    log = StringIO()
    context = Context.build("cpu", memory=spare, watch=watch, progress=Progress(log, interval=0.0))
    problem = replace(stage.problem, context=context)
    functions = torch.zeros(stage.problem.btf.pair_count, stage.points.shape[1], 3)
    clusters = Clusters.of_labels(stage.points, functions, labels)
    found = fit_texels(problem, clusters, stage.dictionary)
    assert len(found) == CLUSTERS
    assert "100 % (100 of 100 texels)" in log.getvalue()
    return found


def test_memory_decides_how_many_at_once_and_changes_no_bit(stage: SelectStage) -> None:
    room = cluster_bytes(LOBES)
    assert module._clusters_at_once(replace(stage, spare=room), CLUSTERS) == (2, 1)
    assert module._clusters_at_once(replace(stage, spare=room - 1), CLUSTERS) == (1, 1)
    assert module._clusters_at_once(stage, 1) == (1, 2)
    some, none = (fits(stage, spare, Stopwatch(CPU)) for spare in (1 << 30, 0))
    for one, other in zip(some, none, strict=True):
        mine, theirs = one.to_tensors(), other.to_tensors()
        assert all(torch.equal(mine[name], theirs[name]) for name in mine)


def test_seconds_are_those_of_a_clock(stage: SelectStage) -> None:
    """Of two clusters at once each counts half, so stages add up to what passes."""
    watch = Stopwatch(CPU)
    with watch("total"):
        fits(stage, 1 << 30, watch)
    stages = {name: spent for name, spent in watch.seconds.items() if name != "total"}
    assert set(stages) <= {"select", "refit", "evaluate", "residual"}
    assert {"select", "evaluate"} <= set(stages)
    assert 0.0 < sum(stages.values()) <= watch.seconds["total"]


@pytest.mark.parametrize("pilot", [4, None])
def test_products_of_a_shared_dictionary_are_computed_once(
    stage: SelectStage, pilot: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 806 lobes and 32 clusters they were a twentieth of a fit."""
    given: list[torch.Tensor | None] = []
    original = module.cluster_products

    def recorded(*args: Any, gram: torch.Tensor | None = None, **options: Any) -> Products:
        given.append(gram)
        found = original(*args, gram=gram, **options)
        torch.testing.assert_close(found.gram, args[3] @ args[3].T)
        return found

    monkeypatch.setattr(module, "cluster_products", recorded)
    config = FitConfig.from_dict({**FLAT, "select": {"pilot": pilot}})
    planned = replace(stage, problem=replace(stage.problem, config=config))
    shared = fits(planned, 1 << 30, Stopwatch(CPU))
    assert len(given) == CLUSTERS * (1 if pilot is None else 2)
    assert all(gram is not None for gram in given)
    given.clear()
    monkeypatch.setattr(Dictionary, "is_shared", False)
    apart = fits(planned, 1 << 30, Stopwatch(CPU))
    assert sum(gram is None for gram in given) == CLUSTERS  # then those of a pilot serve
    for one, other in zip(shared, apart, strict=True):
        assert torch.equal(one.index, other.index)
        torch.testing.assert_close(one.weights, other.weights)


@pytest.mark.parametrize("pilot", [4, None])
@pytest.mark.parametrize("shared", [True, False])
def test_all_clusters_at_once_are_fit_as_one_by_one(
    stage: SelectStage, pilot: int | None, shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a GPU does, on a CPU: in blocks, with pilots, and with lobes of each cluster's own."""
    monkeypatch.setattr(together, "CUDA_TEXELS", 30)
    config = FitConfig.from_dict({"relief": {"mode": "off"}, "select": {"pilot": pilot}})
    context = Context.build("cpu", memory=1 << 30)
    problem = replace(stage.problem, config=config, context=context)
    choices = [torch.arange(0 if shared else k, LOBES, 1 if shared else 2) for k in range(CLUSTERS)]
    dictionary = replace(stage.dictionary, choices=choices)
    labels = torch.arange(problem.btf.texel_count) // 20
    functions = torch.zeros(problem.btf.pair_count, stage.points.shape[1], 3)
    clusters = Clusters.of_labels(stage.points, functions, labels)
    expected = fit_texels(problem, clusters, dictionary)
    found = together._fit_all(problem, clusters, dictionary)
    for one, other in zip(found, expected, strict=True):
        slots = other.index.shape[1]
        assert torch.equal(one.index[:, :slots], other.index) and bool(
            (one.index[:, slots:] < 0).all()
        )
        torch.testing.assert_close(one.weights[:, :slots], other.weights, rtol=1e-4, atol=1e-6)
        residuals = (part.code.float() * part.scale for part in (one, other))
        torch.testing.assert_close(*residuals, rtol=1e-3, atol=1e-5)
        assert one.totals.row() == pytest.approx(other.totals.row(), rel=1e-5)
    tables = (sum(fit.solvers.table for fit in fits) for fits in (found, expected))
    torch.testing.assert_close(*tables)
