"""A model on the simulated device: values, samples, densities, pictures and training steps."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.benchmark.launches.tally import Tally
from spmm_torch.geometry.directions import RULES
from spmm_torch.runtime import tensor_file
from tests.planted.directions import random_directions
from tests.planted.models import (
    FEW_RINGS,
    planted_model,
    planted_relief,
    with_components,
    with_relief,
)

SIZE, QUERIES, STEPS = 5, 200, 3
# A call waits for the lengths of lists, some 65 times at most, however many queries there are.
MOST_WAITS = 72


def models() -> dict[str, SPMM]:
    """With a residual of clusters, of rank R, of both; and over reliefs."""
    clusters = planted_model(SIZE, rings=FEW_RINGS, residual=0.05)
    rank, both = (with_components(clusters, beside=beside) for beside in (False, True))
    relieved = {rule: with_relief(both, planted_relief(SIZE, SIZE, rule=rule)) for rule in RULES}
    return {"clusters": clusters, "components": rank, "both": both, **relieved}


@pytest.fixture(params=list(models()))
def model(request: pytest.FixtureRequest) -> SPMM:
    return models()[request.param]


def queries() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Places `[Q, 2]`, directions `[Q, 3]` twice, and random numbers `[Q, 3]`."""
    generator = torch.Generator().manual_seed(4)
    wi, wo = (random_directions(QUERIES, seed, 1.5, dtype=torch.float32) for seed in (1, 2))
    uv, u = (torch.rand(QUERIES, width, generator=generator) for width in (2, 3))
    return uv, wi, wo, u


CALLS: dict[str, Callable[[SPMM, Tensor, Tensor, Tensor, Tensor], object]] = {
    "forward": lambda model, uv, wi, wo, u: model(uv, wi, wo),
    "forward without residual": lambda model, uv, wi, wo, u: model(uv, wi, wo, residual=False),
    "sample": lambda model, uv, wi, wo, u: model.sample(uv, wo, u),
    "pdf": lambda model, uv, wi, wo, u: model.pdf(uv, wi, wo),
    "picture": lambda model, uv, wi, wo, u: model.picture(wi[0], wo[0]),
}


def on_host(found: object) -> object:
    """Results, each of which must be on the device, in host memory."""
    if isinstance(found, Tensor):
        assert found.is_cuda
        return found.cpu()
    assert isinstance(found, tuple)
    return tuple(map(on_host, found))


@torch.no_grad()
@pytest.mark.parametrize("call", CALLS)
def test_calls_give_what_the_host_gives(model: SPMM, call: str, cuda: Tally) -> None:
    asked = queries()
    expected = CALLS[call](model, *asked)
    there, asked = model.to("cuda"), tuple(part.cuda() for part in asked)
    CALLS[call](there, *asked)  # makes the tables that a model keeps
    cuda.waits.clear()
    found = CALLS[call](there, *asked)
    assert sum(cuda.waits.values()) <= MOST_WAITS, cuda.waits
    torch.testing.assert_close(on_host(found), expected, rtol=1e-4, atol=1e-5)


def trained(model: SPMM, device: str) -> tuple[list[float], SPMM]:
    """Losses of a few steps towards a grey model, and the model after them, on the CPU."""
    model = model.to(device)
    uv, wi, wo, _ = (part.to(device) for part in queries())
    parameters = [part for part in model.parameters() if part.is_floating_point()]
    optimizer = torch.optim.Adam([part.requires_grad_() for part in parameters], lr=0.01)
    losses = []
    for _ in range(STEPS):
        optimizer.zero_grad()
        loss = (model(uv, wi, wo) - 0.1 * wi[:, 2:]).square().mean()
        loss.backward()
        optimizer.step()
        model.project_()
        losses.append(float(loss.detach()))
    return losses, model.to("cpu")


def test_training_steps(model: SPMM, cuda: Tally) -> None:
    expected, host = trained(copy.deepcopy(model), "cpu")
    losses, device = trained(copy.deepcopy(model), "cuda")
    assert losses == pytest.approx(expected, rel=1e-4)
    assert losses[-1] < losses[0]
    for name, value in host.state_dict().items():
        torch.testing.assert_close(device.state_dict()[name], value, rtol=1e-3, atol=1e-4)


def test_a_file_is_read_to_the_device_and_written_from_it(
    model: SPMM, tmp_path: Path, cuda: Tally
) -> None:
    packed = model.pack()
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(packed)
    there = SPMM.load(tmp_path, "cuda")
    assert all(part.is_cuda for part in there.parameters())
    assert there.pack() == packed
