"""A texel's lobes and samples, and how they are told."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from spmm_torch import SPMM, load_btf
from spmm_torch.data import sample_path
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.model.relief import Relief
from spmm_torch.viz.measured import measured_input, measured_samples
from spmm_torch.viz.texel import angles_text, lobe_text, luminance, texel_index, texel_lobes
from tests.planted.btfs import tabulated
from tests.planted.models import planted_model, with_relief

WO = direction_from_angles(torch.tensor(0.5), torch.tensor(1.0))


def test_lobes_are_those_of_the_texel_brightest_first(model: SPMM) -> None:
    texel = texel_lobes(model, 13)
    entries = slice(int(model.offset[13]), int(model.offset[14]))
    weight = model.weight[entries].detach()
    assert sorted(map(tuple, texel.weight.tolist())) == sorted(map(tuple, weight.tolist()))
    bright = luminance(texel.weight)
    assert bool((bright[1:] <= bright[:-1]).all())


def test_the_sum_of_lobes_is_the_model(model: SPMM) -> None:
    wi = direction_from_angles(torch.linspace(0.0, 1.4, 9), torch.linspace(0.0, 6.0, 9))
    total = texel_lobes(model, 13).values(wi, WO).sum(0)
    uv = torch.tensor([5.5 / 8.0, 1.0 - 1.5 / 8.0])  # column 5 of row 1
    with torch.no_grad():
        assert torch.allclose(total, model(uv, wi, WO, residual=False), atol=1e-5)


@pytest.mark.parametrize(("x", "y"), [(-1, 0), (8, 0), (0, 8), (0, -1)])
def test_a_texel_outside_is_refused(model: SPMM, x: int, y: int) -> None:
    with pytest.raises(ConfigError, match=f"--texel {x},{y} lies outside .* from 0 to 7"):
        texel_index(model, x, y)


def test_samples_are_those_of_the_nearest_view(model: SPMM) -> None:
    btf = tabulated(model)
    wanted = btf.view[7] + torch.tensor([0.01, 0.0, 0.0])
    measured = measured_samples(btf, model, 13, wanted)
    assert torch.equal(measured.wo, btf.view[7])
    assert torch.equal(measured.value, btf.texels(torch.tensor([13]))[0].view(81, 81, 3)[7])


def test_samples_follow_the_relief(model: SPMM) -> None:
    """A plane that shifts the view by two texels to the left."""
    btf = tabulated(model)
    wo = direction_from_angles(torch.tensor(0.7), torch.tensor(0.0))
    view = int((btf.view @ wo).argmax())
    slope = float(btf.view[view, 0] / btf.view[view, 2])
    assert abs(float(btf.view[view, 1])) < 1e-6
    low = with_relief(model, Relief(None, 0.0, 2.0 / 8.0 / slope))
    measured = measured_samples(btf, low, 13, btf.view[view])
    expected = btf.texels(torch.tensor([11]))[0].view(81, 81, 3)[view]
    torch.testing.assert_close(measured.value, expected, rtol=1e-4, atol=1e-5)


def test_a_btf_of_another_size_is_refused(model: SPMM) -> None:
    with pytest.raises(DataError, match="has 40 x 40 texels and the model 8 x 8"):
        measured_samples(load_btf(sample_path()), model, 0, WO)


def test_the_input_of_a_run_is_optional(run: Path, tmp_path: Path) -> None:
    assert measured_input(run, None) is None
    (run / "report.json").write_text('{"input": "no/such/btf.zip"}')
    (run / "config.yaml").write_text("seed: 0")
    assert measured_input(run, None) is None
    with pytest.raises(DataError, match="no/such/btf.zip does not exist"):
        measured_input(run, "no/such/btf.zip")
    (run / "report.json").write_text(f'{{"input": "{sample_path()}"}}')
    btf = measured_input(run, None)
    assert btf is not None
    assert btf.height == 40


def test_words_of_a_lobe() -> None:
    model = planted_model(names=("ward",), lobes_per_texel=1)
    words = lobe_text(texel_lobes(model, 0), 0)
    assert words.startswith("Ward   weight ")
    assert "normal " in words
    assert "alpha_x " in words
    assert "alpha_y " in words


@pytest.mark.parametrize(
    ("theta", "phi", "text"),
    [(0.0, 2.0, "0°, 0°"), (45.0, 90.0, "45°, 90°"), (60.0, -90.0, "60°, 270°")],
)
def test_angles(theta: float, phi: float, text: str) -> None:
    angles = torch.deg2rad(torch.tensor([theta, phi], dtype=torch.float64))
    assert angles_text(direction_from_angles(*angles)) == text
