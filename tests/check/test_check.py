"""Faults planted in the BTF of a known model are found, each by its own check alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.check import Finding, check_btf
from spmm_torch.check.energy import reflectance, solid_angles
from spmm_torch.check.sums import Sums
from spmm_torch.geometry.directions import direction_from_angles, ring_directions
from tests.planted.models import planted_model

DIRECTIONS = ring_directions()[:37]  # up to 45 degrees
COSINE = DIRECTIONS[:, 2].view(1, -1, 1, 1, 1)
SIDE = 24


@pytest.fixture(scope="module")
def planted() -> Tensor:
    """Values `[V, L, H, W, C]` of a model, below 1 and with the cosine."""
    model = planted_model(SIDE, names=("lambertian", "oren_nayar", "ward"))
    with torch.no_grad():
        rho = model.dictionary.eval_grid(DIRECTIONS, DIRECTIONS)
        texel = torch.repeat_interleave(model.lobe_count_per_texel())
        values = torch.zeros(SIDE**2, rho.shape[1], 3)
        values.index_add_(0, texel, model.weight[:, None] * rho[model.index, :, None])
    count = len(DIRECTIONS)
    pictures = values.view(SIDE, SIDE, count, count, 3).permute(2, 3, 0, 1, 4).contiguous()
    return 0.4 * pictures / float(pictures.max())


def found(values: Tensor, view: Tensor = DIRECTIONS, light: Tensor = DIRECTIONS) -> dict:
    btf = BTF.from_values(values, view, light, negative="keep")
    return {each.name: each for each in check_btf(btf)}


def faults(findings: dict[str, Finding]) -> set[str]:
    return {name for name, each in findings.items() if each.fine is False}


def uneven(values: Tensor) -> Tensor:
    """Lights that are brighter from the right."""
    return values * (1.0 + 0.9 * DIRECTIONS[:, 0]).view(1, -1, 1, 1, 1)


def test_a_planted_btf_is_fine(planted: Tensor) -> None:
    findings = found(planted)
    assert not faults(findings)
    assert findings["cosine"].figures["slope"] == pytest.approx(1.0, abs=0.03)
    assert findings["gamma"].figures["gamma"] == pytest.approx(1.0, abs=0.03)
    assert findings["reciprocity"].figures["asymmetry"] < 0.02
    assert findings["values"].figures["highest"] == pytest.approx(0.4)


PLANTED = {
    "no cosine": (lambda values: values / COSINE, {"cosine"}),
    "encoded": (lambda values: values ** (1.0 / 2.2), {"gamma"}),
    # Peaks of a power of the values are narrower than those of the values.
    "decoded twice": (lambda values: values**2.2, {"cosine", "gamma", "sampling"}),
    "not reciprocal": (uneven, {"reciprocity"}),
    "too bright": (lambda values: 60.0 * values, {"energy"}),
    "other unit": (lambda values: 1e-8 * values, {"values"}),
}


@pytest.mark.parametrize("name", PLANTED)
def test_planted_faults(planted: Tensor, name: str) -> None:
    change, expected = PLANTED[name]
    assert faults(found(change(planted))) == expected


def test_clipped_highlights(planted: Tensor) -> None:
    top = float(np.quantile(planted.numpy(), 0.99))
    findings = found(planted.clamp(max=top))
    assert "clipping" in faults(findings)
    assert findings["clipping"].figures["share_at_highest"] == pytest.approx(0.01, abs=1e-3)


def test_gammas_are_guessed(planted: Tensor) -> None:
    for gamma in (1.8, 2.2, 2.6):
        guess = found(planted ** (1.0 / gamma))["gamma"].figures["gamma"]
        assert guess == pytest.approx(gamma, rel=0.08)


def test_hot_pixels_are_counted(planted: Tensor) -> None:
    values = planted.clone()
    values[3, 4, 5, 6] = 5000.0
    values[7, 0, 1, 2, 1] = 9000.0
    hot = found(values)["hot pixels"]
    assert hot.fine is False
    assert hot.figures["hot"] == 2
    assert "view 3, light 4, row 5, column 6" in hot.says


def test_missing_pairs(planted: Tensor) -> None:
    btf = BTF.from_values(planted, DIRECTIONS, DIRECTIONS)
    gone = torch.zeros(len(DIRECTIONS), len(DIRECTIONS), dtype=torch.bool)
    gone[2, 3] = gone[9, 1] = True
    btf.missing = gone
    findings = {each.name: each for each in check_btf(btf)}
    assert faults(findings) == {"pairs"}
    assert findings["pairs"].figures["missing"] == 2


def textured(shift: Tensor) -> Tensor:
    """A texture of noise, the same under all lights, shifted by whole texels in each view."""
    generator = torch.Generator().manual_seed(2)
    texture = torch.rand(48, 48, 1, generator=generator).expand(-1, -1, 3)
    views = [texture.roll(tuple(each), (0, 1)) for each in shift.tolist()]
    light = COSINE.expand(len(views), -1, 48, 48, 3)
    return 0.3 * torch.stack(views)[:, None] * light


@pytest.mark.parametrize(("drifts", "fine"), [(0, True), (3, False)])
def test_drift_of_views(drifts: int, fine: bool) -> None:
    generator = torch.Generator().manual_seed(1)
    shift = torch.randint(-drifts, drifts + 1, (len(DIRECTIONS), 2), generator=generator)
    shift[0] = 0
    registration = found(textured(shift))["registration"]
    assert registration.fine is fine
    if drifts:
        assert registration.figures["drift_texels"] > 2.0
    assert registration.figures["views"] == len(DIRECTIONS) - 1


def test_a_plane_below_the_texture_is_no_drift() -> None:
    tangent = DIRECTIONS[:, :2] / DIRECTIONS[:, 2:]
    shift = (4.0 * torch.stack((-tangent[:, 1], tangent[:, 0]), 1)).round().int()
    registration = found(textured(shift))["registration"]
    assert registration.fine
    assert registration.figures["plane_texels"] == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize(("width", "fine"), [(4.0, False), (30.0, True)])
def test_peaks_against_their_sampling(width: float, fine: bool) -> None:
    """Peaks about the mirror that fall to a half at `width` degrees, over a dull base."""
    mirror = DIRECTIONS * torch.tensor([-1.0, -1.0, 1.0])
    apart = torch.arccos((mirror @ DIRECTIONS.T).clamp(-1.0, 1.0)).rad2deg()  # [V, L]
    peak = 0.02 + torch.exp2(-((apart / width) ** 2))
    values = (peak * DIRECTIONS[:, 2])[..., None, None, None].expand(-1, -1, 4, 4, 3)
    sampling = found(0.2 * values)["sampling"]
    assert sampling.fine is fine
    if not fine:
        assert sampling.figures["half_width_degrees"] < 10.0
        assert sampling.figures["spacing_degrees"] == pytest.approx(15.0, abs=1.0)


def test_too_little_to_tell(planted: Tensor) -> None:
    light = direction_from_angles(torch.full((37,), 0.5), torch.arange(37) * 0.17)
    findings = found(planted[:, :, :4, :4], light=light)
    unknown = {name for name, each in findings.items() if each.fine is None}
    assert unknown == {"cosine", "gamma", "reciprocity", "registration"}


def test_solid_angles_and_reflectance() -> None:
    """Those of a Lambertian of albedo 0.8, whatever the lights, and with a pair left out."""
    for directions in (ring_directions(), ring_directions(((0.0, 1), (45.0, 12), (88.0, 24)))):
        mean = 0.8 / math.pi * directions[:, 2].expand(1, -1)[..., None]
        measured = torch.ones(1, len(directions))
        share = reflectance(mean, directions, measured)
        assert float(share) == pytest.approx(0.8, rel=0.01)
        measured[0, 3] = 0.0
        assert float(reflectance(mean, directions, measured)) == pytest.approx(0.8, rel=0.05)
    assert float(solid_angles(torch.tensor([[0.0, 0.0, 1.0]]))) == pytest.approx(math.pi, rel=0.01)


def test_sums_do_not_depend_on_blocks(planted: Tensor, monkeypatch: pytest.MonkeyPatch) -> None:
    btf = BTF.from_values(planted, DIRECTIONS, DIRECTIONS)
    whole = Sums.of(btf)
    monkeypatch.setattr("spmm_torch.check.sums.BLOCK_VALUES", 5 * btf.texel_count * 3)
    parts = Sums.of(btf)
    assert torch.equal(whole.mean, parts.mean)
    assert torch.equal(whole.kept, parts.kept)
    assert torch.allclose(whole.pictures, parts.pictures)
    for name in ("highest", "lowest", "at_highest", "zeros", "count", "hot"):
        assert getattr(whole, name) == getattr(parts, name)
    assert whole.count == planted.numel()
