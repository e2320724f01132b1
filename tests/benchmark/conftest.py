"""A planted BTF on disk, and what the parts of a benchmark get of it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from spmm_torch.benchmark.fits import TimedFit, on_device, timed_fit
from spmm_torch.benchmark.peers.problem import Problem
from spmm_torch.benchmark.protocol import Protocol
from spmm_torch.benchmark.scope import SMALL, Bench, Scope
from spmm_torch.benchmark.variants import DEFAULT
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.config.shipped import shipped
from spmm_torch.data import BTF, Selection, write_npz
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runtime.progress import Progress
from tests.planted.btfs import texel_btf
from tests.planted.lobes import random_lobes

SIDE, LOBES = 6, 5
CPU = torch.device("cpu")
SCOPE = Scope(
    Protocol(repeats=2, patience=0.01),
    overrides=(*SMALL.overrides, "cluster.count=2", "search.refine_steps=1"),
    sweep=("precision",),
    search_texels=2,
    dictionary_texels=5,
    training=(0.1,),
    texels=(16, 36),
    few_texels=16,
    direction_texels=4,
    product=64,
    copied=1 << 16,
    selection=Selection(),
)


@pytest.fixture(scope="session")
def planted_btf() -> BTF:
    """36 texels, each a mixture of the same five lobes, on 15 x 15 directions."""
    generator = torch.Generator().manual_seed(5)
    directions = ring_directions(((0.0, 1), (30.0, 6), (60.0, 8)))
    rho = random_lobes(MODEL_NAMES[:LOBES], generator).eval_grid(directions, directions)  # [J, D]
    weights = torch.rand(SIDE * SIDE, 3, LOBES, generator=generator)
    values = (weights @ (rho / rho.norm(dim=1, keepdim=True))).transpose(1, 2)  # [T, D, C]
    return texel_btf(values, directions, height=SIDE)


@pytest.fixture(scope="session")
def bench(planted_btf: BTF, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A benchmark of it that takes little time."""
    path: Path = tmp_path_factory.mktemp("planted") / "planted.npz"
    write_npz(path, planted_btf)
    return Bench(path, SCOPE, CPU, Progress(enabled=False), lambda: None)


@pytest.fixture(scope="session")
def default(bench: Bench) -> TimedFit:
    """Its fit with default settings."""
    return timed_fit(bench, on_device(shipped(DEFAULT, SCOPE.overrides), CPU))


@pytest.fixture
def problem(bench: Bench, default: TimedFit) -> Problem:
    """What peers get."""
    return Problem(bench.open().load(), SCOPE, CPU, default)
