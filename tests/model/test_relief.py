"""A model with a relief: it is the flat model at the points that its views show."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM, OutputError
from spmm_torch.geometry.directions import MIRROR, REPEAT, RULES, direction_from_angles, texel_at
from spmm_torch.geometry.relief import texel_centres
from spmm_torch.model.relief import MAX_HEIGHT, Relief
from spmm_torch.runtime import tensor_file
from tests.planted.directions import random_directions
from tests.planted.models import FEW_RINGS, planted_model, planted_relief, with_relief

SIZE = 8


def flat_model() -> SPMM:
    return planted_model(SIZE, rings=FEW_RINGS, residual=0.05)


@pytest.fixture(params=RULES)
def model(request: pytest.FixtureRequest) -> SPMM:
    flat = flat_model()
    drift = 0.02 * torch.rand(len(flat.view), 2, generator=torch.Generator().manual_seed(4))
    return with_relief(flat, planted_relief(SIZE, SIZE, rule=request.param, drift=drift))


def queries(count: int, seed: int = 1) -> tuple[Tensor, Tensor, Tensor]:
    uv = 3.0 * torch.rand(count, 2, generator=torch.Generator().manual_seed(seed)) - 1.0
    wi, wo = (
        random_directions(count, seed + n, max_theta=1.5, dtype=torch.float32) for n in (1, 2)
    )
    return uv, wi, wo


def test_heights_are_rounded_to_one_byte() -> None:
    height = 0.2 * torch.rand(400, generator=torch.Generator().manual_seed(1)) - 0.05
    relief = Relief.of_heights(height)
    step = float(height.max() - height.min()) / 255
    assert float((relief.height - height).abs().max()) < 0.501 * step
    again = relief.with_heights(relief.height)
    torch.testing.assert_close(again.height, relief.height, rtol=0.0, atol=1e-7)


def test_heights_keep_the_steps_that_they_lie_on() -> None:
    code = torch.tensor([3, 3, 200, 77], dtype=torch.uint8)
    stored = Relief(code, 1e-3, -0.07).encoded()
    assert stored[0] is not None
    assert torch.equal(stored[0], code)
    assert [round(float(part), 6) for part in stored[1:]] == [1e-3, -0.07]


def test_equal_heights_are_a_plane_without_codes() -> None:
    relief = Relief.of_heights(torch.full((9,), 0.125))
    assert relief.encoded()[0] is None
    assert torch.equal(relief.height, torch.tensor([0.125]))
    assert torch.equal(relief.heights(9), torch.full((9,), 0.125))


def test_bad_reliefs_are_refused() -> None:
    with pytest.raises(ValueError, match="known: repeat, mirror"):
        Relief(None, 0.0, 0.0, "clamp")
    with pytest.raises(ValueError, match="beyond 0.5"):
        Relief(None, 0.0, -1.01 * MAX_HEIGHT)


def test_a_flat_relief_changes_no_bit() -> None:
    flat = flat_model()
    zero = with_relief(flat, Relief(None, 0.0, 0.0))
    uv, wi, wo = queries(300)
    assert torch.equal(zero(uv, wi, wo), flat(uv, wi, wo))
    torch.testing.assert_close(zero.picture(wi[0], wo[0]), flat.picture(wi[0], wo[0]))


def test_values_are_those_of_the_flat_model_at_the_hits() -> None:
    flat = flat_model()
    model = with_relief(flat)
    assert model.relief is not None
    uv, wi, wo = queries(400)
    held = model.held_view(wo)
    hit = model.relief.field(SIZE, SIZE, model.view).hit(uv, held)
    assert float((hit - uv).abs().max()) > 0.05
    assert torch.equal(model(uv, wi, wo), flat(hit, wi, held))
    assert torch.equal(model.pdf(uv, wi, wo), flat.pdf(hit, wi, held))
    u = torch.rand(400, 3, generator=torch.Generator().manual_seed(7))
    for found, expected in zip(model.sample(uv, wo, u), flat.sample(hit, held, u), strict=True):
        assert torch.equal(found, expected)


def test_views_below_all_measured_ones_see_what_the_lowest_sees() -> None:
    model = with_relief(flat_model())
    lowest = model.view[model.view[:, 2].argmin()]
    wi = model.light
    uv = torch.rand(len(wi), 2)
    for z in (0.5 * float(lowest[2]), 1e-4):
        planar = lowest[:2] * ((1.0 - z * z) / float(lowest[:2].square().sum())) ** 0.5
        wo = torch.cat((planar, torch.tensor([z])))
        torch.testing.assert_close(model(uv, wi, wo), model(uv, wi, lowest))
        torch.testing.assert_close(model.pdf(uv, wi, wo), model.pdf(uv, wi, lowest))
        torch.testing.assert_close(model.picture(wi[0], wo), model.picture(wi[0], lowest))
    under = torch.tensor([0.0, 0.8, -0.6])
    assert float(model(uv, wi, under).detach().abs().max()) == 0.0


def test_lobes_continue_by_the_rule_of_the_relief() -> None:
    flat = flat_model()
    model = with_relief(flat, Relief(None, 0.0, 0.0, MIRROR))
    uv, wi, wo = queries(200)
    texel, weight = texel_at(uv, SIZE, SIZE, MIRROR)
    centres = texel_centres(SIZE, SIZE, uv)[texel]  # [Q, 4, 2]
    corners = flat(centres, wi[:, None], wo[:, None])
    torch.testing.assert_close(
        model(uv, wi, wo), (corners * weight[..., None]).sum(1), rtol=1e-4, atol=1e-5
    )
    seen = model(torch.tensor([-0.3, 0.4]), wi, wo)
    torch.testing.assert_close(seen, model(torch.tensor([0.3, 0.4]), wi, wo))


def test_pictures_are_values_at_texel_centres(model: SPMM) -> None:
    centres = texel_centres(SIZE, SIZE, model.view)
    for wi, wo in ((model.light[3], model.view[12]), (model.light[0], model.view[-1])):
        for residual in (False, True):
            expected = model(centres, wi, wo, residual=residual).view(SIZE, SIZE, 3)
            found = model.picture(wi, wo, residual)
            torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_shapes_broadcast(model: SPMM) -> None:
    uv, wi, wo = queries(7)
    grid = model(uv[:5, None], wi, wo)
    assert grid.shape == (5, 7, 3)
    torch.testing.assert_close(grid[3], model(uv[3], wi, wo))
    torch.testing.assert_close(grid[3, 2], model(uv[3], wi[2], wo[2]))
    assert model(uv[:0], wi[:1], wo[:1]).shape == (0, 3)


def test_values_under_the_horizon_are_0(model: SPMM) -> None:
    uv, wi, wo = queries(20)
    below = wo * torch.tensor([1.0, 1.0, -1.0])
    assert not model(uv, wi, below).any()
    assert not model(uv, below, wo).any()
    assert bool(model(uv, wi, torch.tensor([1.0, 0.0, 0.0])).isfinite().all())


def test_samples_estimate_what_the_model_reflects(model: SPMM) -> None:
    generator = torch.Generator().manual_seed(3)
    count = 40_000
    uv = torch.tensor([0.43, 0.61])
    wo = direction_from_angles(torch.tensor(1.0), torch.tensor(2.0))
    wi, rgb, density = model.sample(uv, wo, torch.rand(count, 3, generator=generator))
    torch.testing.assert_close(rgb, model(uv, wi, wo))
    torch.testing.assert_close(density, model.pdf(uv, wi, wo))
    estimate, spread = (rgb / density[:, None]).mean(0), (rgb / density[:, None]).std(0)
    uniform = random_directions(400_000, 5, dtype=torch.float32)
    values = 2.0 * math.pi * model(uv, uniform, wo)
    error = (spread.square() / count + values.var(0) / len(values)).sqrt()
    assert ((estimate - values.mean(0)).abs() < 4.5 * error).all()


def test_round_trip(tmp_path: Path, model: SPMM) -> None:
    path = tmp_path / tensor_file.MODEL_FILE
    path.write_bytes(model.pack())
    loaded = SPMM.load(path)
    theirs = loaded.state_dict()
    for name, tensor in model.state_dict().items():
        assert torch.equal(theirs[name], tensor), name
    assert loaded.relief is not None
    assert model.relief is not None
    assert loaded.relief.rule == model.relief.rule
    assert loaded.pack() == model.pack()
    uv, wi, wo = queries(100)
    assert torch.equal(loaded(uv, wi, wo), model(uv, wi, wo))


def test_a_plane_takes_four_bytes(tmp_path: Path) -> None:
    flat = flat_model()
    model = with_relief(flat, Relief(None, 0.0, 0.03))
    tensors, _ = model.to_tensors()
    assert [name for name in tensors if name.startswith("relief.")] == ["relief.offset"]
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    assert SPMM.load(tmp_path).pack() == model.pack()


def test_only_a_relief_raises_the_version(tmp_path: Path) -> None:
    flat = flat_model()
    flat.horizon = 0.0
    for version, each in (("1", flat), ("2", with_relief(flat))):
        content = each.pack()
        header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
        assert header["__metadata__"]["version"] == version


def test_damaged_reliefs_end_in_a_sentence(tmp_path: Path) -> None:
    tensors, metadata = with_relief(flat_model()).to_tensors()
    path = tmp_path / "x.safetensors"
    lacking = {name: tensor for name, tensor in tensors.items() if name != "relief.scale"}
    ruled = {key: value for key, value in metadata.items() if key != "rule"}
    for content in (
        tensor_file.pack(lacking, metadata),
        tensor_file.pack(tensors, ruled),
        tensor_file.pack(tensors, {**metadata, "rule": "clamp"}),
        tensor_file.pack({**tensors, "relief.scale": torch.ones(1)}, metadata),
    ):
        path.write_bytes(content)
        with pytest.raises(OutputError, match=r"x.safetensors lacks a part"):
            SPMM.load(path)


def test_heights_can_be_optimised() -> None:
    """Gradients agree with differences of values, and descend to a planted plane."""
    flat = flat_model().double()
    truth = with_relief(flat, Relief(None, 0.0, 0.04)).double()
    model = with_relief(flat, Relief(None, 0.0, 0.0)).double()
    assert model.relief is not None
    height = model.relief.height.requires_grad_()
    generator = torch.Generator().manual_seed(2)
    uv = torch.rand(2000, 2, generator=generator).double()
    wi, wo = (random_directions(2000, seed, max_theta=1.0) for seed in (3, 4))
    target = truth(uv, wi, wo).detach()

    def error() -> Tensor:
        return (model(uv, wi, wo) - target).square().mean()

    (gradient,) = torch.autograd.grad(error(), height)
    with torch.no_grad():
        step = 1e-7
        height += step
        above = error()
        height -= 2.0 * step
        below = error()
        height += step
    assert float(gradient) == pytest.approx(float(above - below) / (2.0 * step), rel=1e-3)
    optimizer = torch.optim.Adam([height], lr=4e-3)
    for _ in range(60):
        optimizer.zero_grad()
        error().backward()
        optimizer.step()
    assert float(height.detach()) == pytest.approx(0.04, abs=2e-3)


def test_fields_are_kept_as_long_as_heights_stay(model: SPMM) -> None:
    relief = copy.deepcopy(model.relief)
    assert relief is not None
    first = relief.field(SIZE, SIZE, model.view)
    assert relief.field(SIZE, SIZE, model.view) is first
    with torch.no_grad():
        relief.height += 0.01
    moved = relief.field(SIZE, SIZE, model.view)
    torch.testing.assert_close(moved.height, first.height + 0.0, rtol=0.0, atol=0.02)
    assert moved is not first
    relief.height.requires_grad_()
    assert relief.field(SIZE, SIZE, model.view).height.requires_grad


def test_a_relief_made_in_inference_mode() -> None:
    flat, given = flat_model(), queries(50)
    expected = with_relief(flat, planted_relief(SIZE, SIZE))(*given)
    with torch.inference_mode():
        model = with_relief(flat, planted_relief(SIZE, SIZE))
        assert torch.equal(model(*given), expected)
        assert torch.equal(model(*given), expected)  # by the field that is kept
    assert torch.equal(model(*given), expected)


@pytest.mark.gpu
@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_same_on_cuda(rule: str) -> None:
    model = with_relief(flat_model(), planted_relief(SIZE, SIZE, rule=rule))
    uv, wi, wo = queries(200)
    expected = model(uv, wi, wo)
    found = model.to("cuda")(uv.cuda(), wi.cuda(), wo.cuda())
    torch.testing.assert_close(found.cpu(), expected, rtol=1e-3, atol=1e-4)
