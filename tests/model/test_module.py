"""The model as a part of larger programs: batches of nothing, workers, modes, training, borders."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from spmm_torch import SPMM, ConfigError
from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import MIRROR, REPEAT, ring_directions
from tests.planted.directions import random_directions
from tests.planted.models import planted_relief, uneven_model, with_components, with_relief

HEIGHT, WIDTH = 2, 3
LIGHT = ring_directions(((0.0, 1), (35.0, 6), (70.0, 10)))
COUNTS = (0, 1, len(MODEL_NAMES), 2, 4, 3)


def build(relief_rule: str | None = REPEAT) -> SPMM:
    model = with_components(uneven_model(COUNTS, HEIGHT, LIGHT, LIGHT), beside=True)
    if relief_rule is None:
        return model
    return with_relief(model, planted_relief(HEIGHT, WIDTH, 0.2, relief_rule))


@pytest.fixture
def model() -> SPMM:
    return build()


def queries(count: int) -> tuple[Tensor, Tensor, Tensor]:
    uv = torch.rand(count, 2, generator=torch.Generator().manual_seed(1))
    wi, wo = (random_directions(count, seed, 1.4, torch.float32) for seed in (2, 3))
    return uv, wi, wo


@pytest.mark.parametrize("rule", [REPEAT, None])
@pytest.mark.parametrize("shape", [(0,), (2, 0, 3)])
def test_batches_of_nothing(rule: str | None, shape: tuple[int, ...]) -> None:
    model = build(rule)
    uv, wi, wo, u = (torch.zeros(*shape, n) for n in (2, 3, 3, 3))
    for padded in (False, True):
        assert model(uv, wi, wo, padded=padded).shape == (*shape, 3)
    parts = model.sample(uv, wo, u)
    assert [part.shape for part in parts] == [(*shape, 3), (*shape, 3), shape]
    assert model.pdf(uv, wi, wo).shape == shape
    assert torch.func.vmap(model, in_dims=(None, None, 0))(uv, wi, wo[None]).shape == (1, *shape, 3)


def test_gradient_of_nothing(model: SPMM) -> None:
    uv, wi, wo = (torch.zeros(0, n, requires_grad=True) for n in (2, 3, 3))
    model(uv, wi, wo).sum().backward()
    assert model.weight.grad is not None and not model.weight.grad.any()


class Pictures(Dataset[Tensor]):
    """Evaluates the model in `__getitem__`, as a set of training pictures does."""

    def __init__(self, model: SPMM) -> None:
        self.model = model

    def __len__(self) -> int:
        return 4

    def __getitem__(self, index: int) -> Tensor:
        with torch.no_grad():
            return self.model(*queries(index + 3))[:3]


def test_workers_of_a_loader(model: SPMM) -> None:
    """Forked after the model has kept what it keeps, and used threads."""
    expected = torch.stack([Pictures(model)[index] for index in range(4)])
    loader = DataLoader(Pictures(model), batch_size=2, num_workers=1)
    torch.testing.assert_close(torch.cat(list(loader)), expected)


def test_a_forked_child_samples_and_differentiates(model: SPMM) -> None:
    uv, wi, wo = queries(300)
    model.sample(uv, wo, torch.rand(300, 3))
    child = os.fork()
    if child == 0:
        try:
            model(uv, wi, wo).sum().backward()
            model.sample(uv, wo, torch.rand(300, 3))
            os._exit(7)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


@pytest.fixture
def double_by_default() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("padded", [False, True])
def test_default_type_of_the_program(padded: bool, request: pytest.FixtureRequest) -> None:
    given = queries(20)
    expected = build()(*given, padded=padded)
    kept = build()
    tensors = kept.to_tensors()
    request.getfixturevalue("double_by_default")
    for model in (kept, SPMM.from_tensors(*tensors)):
        assert torch.equal(model(*given, padded=padded), expected)


@pytest.mark.parametrize("padded", [False, True])
def test_modes_of_the_program(model: SPMM, padded: bool) -> None:
    given = queries(20)
    expected = build()(*given, padded=padded)
    with torch.inference_mode():
        assert torch.equal(model(*given, padded=padded), expected)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(model(*given, padded=padded), expected)
    model(*given, padded=padded).sum().backward()  # nothing of the first call is in the way
    assert model.kappa.grad is not None


def test_a_model_loaded_in_inference_mode(model: SPMM, tmp_path: Path) -> None:
    model.save(tmp_path / "model.safetensors")
    given = queries(20)
    with torch.inference_mode():
        loaded = SPMM.load(tmp_path)
        torch.testing.assert_close(loaded(*given), SPMM.load(tmp_path)(*given, padded=True))
        loaded.sample(given[0], given[2], torch.rand(20, 3))
    loaded(*given).sum().backward()
    assert loaded.kappa.grad is not None


def test_lobes_are_frozen_or_trained(model: SPMM) -> None:
    assert model.requires_grad_lobes(False) is model
    model(*queries(5)).sum().backward()
    assert model.weight.grad is not None
    assert model.kappa.grad is model.normal.grad is model.angle.grad is None
    model.requires_grad_lobes()
    model(*queries(5)).sum().backward()
    assert all(part.grad is not None for part in (model.kappa, model.normal, model.angle))


@pytest.mark.parametrize("kind", [torch.optim.Adam, torch.optim.SGD])
def test_constraints_hold_after_each_step(model: SPMM, kind: type[torch.optim.Optimizer]) -> None:
    optimizer = kind(model.parameters(), lr=30.0)  # type: ignore[call-arg]

    def hold(*_: object) -> None:
        model.project_()

    optimizer.register_step_post_hook(hold)
    for _ in range(2):
        optimizer.zero_grad()
        model(*queries(50)).square().sum().backward()
        optimizer.step()
        assert (model.weight >= 0.0).all()
        torch.testing.assert_close(model.normal.norm(dim=1), torch.ones(len(model.normal)))
        for lobe, index in enumerate(model.lobe_model.tolist()):
            for value, row in zip(
                model.kappa.detach()[lobe], REGISTRY[index].parameters, strict=False
            ):
                assert row.low - 1e-6 <= float(value) <= row.high * (1.0 + 1e-6)
    model.pack()


def test_sampling_follows_training(model: SPMM) -> None:
    uv, wi, wo = queries(50)
    before = model.pdf(uv, wi, wo)
    with torch.no_grad():
        model.weight[::2] *= 20.0
    after = model.pdf(uv, wi, wo)
    assert not torch.equal(before, after)
    model.weight.data[::2] /= 20.0  # torch counts no changes through .data
    assert torch.equal(model.pdf(uv, wi, wo), after)
    model.sampling_data(renew=True)
    torch.testing.assert_close(model.pdf(uv, wi, wo), before)


@pytest.mark.parametrize("padded", [False, True])
@pytest.mark.parametrize("rule", [None, REPEAT, MIRROR])
def test_clamped_borders(rule: str | None, padded: bool) -> None:
    model = build(rule)
    uv, wi, wo = queries(60)
    inner = 0.5 / torch.tensor([WIDTH, HEIGHT])
    outer = 4.0 * uv - 1.5
    with torch.no_grad():
        model.wrap = "clamp"
        held = torch.maximum(torch.minimum(outer, 1.0 - inner), inner)
        clamped = model(outer, wi, wo, padded=padded)
        same = model(held, wi, wo, padded=padded)
        model.wrap = None
        for expected in (same, model(held, wi, wo, padded=padded)):
            torch.testing.assert_close(clamped, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("padded", [False, True])
@pytest.mark.parametrize("wrap", [REPEAT, MIRROR])
@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_another_rule_than_that_of_the_relief(rule: str, wrap: str, padded: bool) -> None:
    model, other = build(rule), build(wrap)
    uv, wi, wo = queries(60)
    model.wrap = wrap
    found = model(4.0 * uv - 1.5, wi, wo, padded=padded)
    torch.testing.assert_close(found, other(4.0 * uv - 1.5, wi, wo), rtol=1e-4, atol=1e-5)


def test_a_flat_texture_can_be_mirrored() -> None:
    model = build(None)
    uv, wi, wo = queries(60)
    folded = 1.0 - (1.0 - torch.remainder(4.0 * uv - 1.5, 2.0)).abs()
    model.wrap = MIRROR
    mirrored = model(4.0 * uv - 1.5, wi, wo)
    model.wrap = "clamp"
    torch.testing.assert_close(mirrored, model(folded, wi, wo), rtol=1e-4, atol=1e-5)


def test_an_unknown_border_is_refused(model: SPMM) -> None:
    with pytest.raises(
        ConfigError, match=r"^wrap is 'tile'; expected one of repeat, mirror, clamp"
    ):
        model.wrap = "tile"
