"""Neural peers learn, are stored in bytes, and find a depth that is planted."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.benchmark.drawing import snr_of_pictures
from spmm_torch.benchmark.peers import neural, neural_depth, training
from spmm_torch.benchmark.peers.neural_btf import LATENT, NeuralBTF
from spmm_torch.benchmark.peers.neural_depth import SURFACE, DepthBTF
from spmm_torch.benchmark.peers.problem import Problem
from spmm_torch.geometry.directions import ring_directions
from tests.planted.reliefs import planted_relief

STEPS, HEIGHT = 300, 0.08
Train = Callable[[training.Build, BTF, float], NeuralBTF]


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch) -> Train:
    """Training for a number of steps of a second each."""
    monkeypatch.setattr(training, "BATCH", 1 << 11)

    def trained(build: training.Build, btf: BTF, seconds: float) -> NeuralBTF:
        clock = itertools.count()
        monkeypatch.setattr(training, "now", lambda device: float(next(clock)))
        model, steps = training.train(build, btf, btf.texels(), seconds)
        assert steps == seconds - 1
        return model

    return trained


@pytest.mark.parametrize("build", [NeuralBTF, DepthBTF])
def test_longer_training_is_better(build: type[NeuralBTF], problem: Problem, train: Train) -> None:
    found = [train(build, problem.btf, seconds) for seconds in (2.0, 100.0)]
    snr = [snr_of_pictures(problem.btf, model.of_view) for model in found]
    assert snr[1] > snr[0] + 3.0


def test_it_is_rounded_to_what_its_bytes_hold(problem: Problem, train: Train) -> None:
    model = train(DepthBTF, problem.btf, 3.0)
    texels = problem.btf.texel_count
    assert model.texel_bytes == texels * (LATENT + SURFACE)
    levels = [len(torch.unique(column)) for texture in model.textures() for column in texture.T]
    assert max(levels) <= min(texels, 255)
    networks = [*model.network.parameters(), *model.depth.parameters()]
    assert all(torch.equal(part, part.half().float()) for part in networks)
    numbers = sum(part.numel() for part in networks)
    assert model.shared_bytes == 2 * numbers + 4 * (LATENT + SURFACE)
    before = model.of_view(1)
    model.store()  # what is rounded stays
    assert model.of_view(1) == pytest.approx(before, rel=1e-3, abs=1e-4)


def test_a_depth_that_is_planted_is_found(train: Train) -> None:
    views = ring_directions(((0.0, 1), (25.0, 6), (45.0, 8)))
    btf = planted_relief(0.0, HEIGHT, size=(16, 16), views=views, noise=0.0).btf
    plain, deep = (train(build, btf, STEPS) for build in (NeuralBTF, DepthBTF))
    assert isinstance(deep, DepthBTF)
    assert snr_of_pictures(btf, deep.of_view) > snr_of_pictures(btf, plain.of_view) + 3.0
    texel = torch.arange(btf.texel_count)
    steep = torch.full_like(texel, len(btf.view) - 1)
    found = deep.depths(texel, steep).detach()
    # The texture may be moved as a whole, so depths are only known up to what is common.
    assert float(found.median()) == pytest.approx(HEIGHT, abs=0.4 * HEIGHT)


def test_a_depth_of_zero_reads_each_texel_itself(problem: Problem) -> None:
    model = DepthBTF(problem.btf, 1.0)
    model.spent = 1.0
    with torch.no_grad():
        model.depth[-1].weight.zero_()
        model.depth[-1].bias.zero_()
        texel, pair = torch.arange(problem.btf.texel_count), torch.full((36,), 17)
        assert model.read(texel, pair) == pytest.approx(model.latent.detach(), abs=1e-5)


@torch.no_grad()
def test_the_blur_keeps_the_mean_and_ends(problem: Problem) -> None:
    model = DepthBTF(problem.btf, 1.0)
    spread: list[Tensor] = []
    for model.spent in (0.0, 0.3, 1.0):
        sharpened = model._sharpened()
        assert sharpened.mean(0) == pytest.approx(model.latent.mean(0), abs=1e-6)
        spread.append(sharpened.var(0).sum())
    assert spread[0] < spread[1] < spread[2] == model.latent.var(0).sum()


def test_rows_name_their_times(problem: Problem) -> None:
    for module in (neural, neural_depth):
        (row,) = module.PEER.run(problem)
        assert row["name"].endswith("0.1 x our time") and row["bytes"] > 0
