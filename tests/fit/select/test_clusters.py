"""All clusters: several at once on a CPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from spmm_torch import FitConfig
from spmm_torch.data import Selection, load_btf, sample_path
from spmm_torch.fit.dictionary import Dictionary
from spmm_torch.fit.select import clusters as stage
from spmm_torch.fit.select.clusters import ClusterFit, Setting, cluster_bytes, fit_texels
from spmm_torch.geometry.directions import hemisphere_spiral
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.grid import DirectionGrid
from spmm_torch.runtime.checkpoint import Checkpoint
from spmm_torch.runtime.ranks import ALONE
from spmm_torch.runtime.stopwatch import Stopwatch
from spmm_torch.runtime.threads import cpu_threads

CPU = torch.device("cpu")
CLUSTERS, LOBES = 5, 20


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    with cpu_threads(2):
        yield


@pytest.fixture(scope="module")
def setting() -> Setting:
    btf = load_btf(sample_path(), selection=Selection(texels=100, directions="0,30,60")).load()
    normal = hemisphere_spiral(LOBES)
    shape = torch.full((LOBES,), 2)  # Blinn-Phong
    kappa = torch.tensor([[8.0, 0.0, 0.0]]).expand(LOBES, -1)
    lobes = LobeBatch(shape, kappa.contiguous(), normal, torch.zeros(LOBES))
    raw = DirectionGrid.build(btf.light, btf.view, CPU).eval(lobes)
    norm = raw.norm(dim=1)
    atoms = raw / norm[:, None]
    choices = [torch.arange(LOBES)] * CLUSTERS
    dictionary = Dictionary(lobes, atoms, norm, choices, raw)
    points = btf.texels().flatten(1)
    config = FitConfig.from_dict({"select": {"pilot": 4}})
    return Setting(btf, points, dictionary, config, Stopwatch(CPU), 1 << 30, ALONE)


def fits(setting: Setting) -> list[ClusterFit]:
    members = list(torch.arange(setting.btf.texel_count).split(20))
    assert len(members) == CLUSTERS
    told: list[int] = []
    found = fit_texels(setting, members, Checkpoint(setting.watch), told.append)
    assert sum(told) == setting.btf.texel_count
    return found


def test_memory_decides_how_many_at_once_and_changes_no_bit(setting: Setting) -> None:
    room = cluster_bytes(LOBES)
    assert stage._clusters_at_once(replace(setting, spare=room), CLUSTERS) == (2, 1)
    assert stage._clusters_at_once(replace(setting, spare=room - 1), CLUSTERS) == (1, 1)
    assert stage._clusters_at_once(setting, 1) == (1, 2)
    for one, other in zip(fits(setting), fits(replace(setting, spare=0)), strict=True):
        mine, theirs = one.to_tensors(), other.to_tensors()
        assert all(torch.equal(mine[name], theirs[name]) for name in mine)


def test_seconds_are_those_of_a_clock(setting: Setting) -> None:
    """Of two clusters at once each counts half, so stages add up to what passes."""
    watch = Stopwatch(CPU)
    with watch("total"):
        fits(replace(setting, watch=watch))
    stages = {name: spent for name, spent in watch.seconds.items() if name != "total"}
    assert set(stages) == {"select", "refit", "evaluate", "residual"}
    assert 0.0 < sum(stages.values()) <= watch.seconds["total"]
