"""Display curves and files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.config.render import check_output
from spmm_torch.data.codecs import openexr
from spmm_torch.errors import ConfigError, OutputError
from spmm_torch.render import (
    auto_exposure,
    display_codes,
    encode_display,
    write_exr,
    write_gif,
    write_png,
)
from spmm_torch.render.display import white_exposure


def test_srgb_is_what_others_say() -> None:
    linear = torch.linspace(0.0, 1.0, 1001, dtype=torch.float64).view(-1, 1).expand(-1, 3)
    back = (encode_display(linear).numpy() + 0.055) / 1.055
    decoded = np.where(back <= (0.04045 + 0.055) / 1.055, (1.055 * back - 0.055) / 12.92, back**2.4)
    np.testing.assert_allclose(decoded, linear.numpy(), atol=1e-6)


def test_gamma_and_clipping() -> None:
    values = torch.tensor([-0.5, 0.0, 0.25, 1.0, 7.0])
    torch.testing.assert_close(encode_display(values, 2.0), torch.tensor([0.0, 0, 0.5, 1, 1]))
    codes = display_codes(values.view(-1, 1, 1).expand(-1, 1, 3), 2.0, 2.0)
    assert codes[:, 0, 0].tolist() == [0, 0, 180, 255, 255]


def test_exposure_looks_at_the_shape_alone() -> None:
    picture, coverage = torch.full((10, 10, 3), 4.0), torch.zeros(10, 10)
    coverage[:5] = 1.0
    picture[:5] = 0.5
    assert auto_exposure([picture], [coverage]) == pytest.approx(2.0)
    assert auto_exposure([0.0 * picture], [coverage]) == 1.0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_exposure_maps_the_99th_percentile_to_one(scale: float) -> None:
    values = np.random.default_rng(0).gamma(1.0, scale, (32, 32, 3)).astype(np.float32)
    shown = values * white_exposure(values)
    assert np.mean(shown > 1.0) == pytest.approx(0.01, abs=0.001)


def test_exposure_of_nearly_and_fully_black() -> None:
    picture = np.zeros((16, 16, 3), np.float32)
    assert white_exposure(picture) == 1.0
    picture[3, 4, 1] = 0.5
    assert white_exposure(picture) == 2.0


def test_files_hold_what_was_given(tmp_path: Path) -> None:
    picture = torch.randn(5, 7, 3, generator=torch.Generator().manual_seed(0)) * 100.0
    write_exr(tmp_path / "x.exr", picture)
    assert np.array_equal(openexr.decode((tmp_path / "x.exr").read_bytes()), picture.numpy())
    codes = display_codes(picture, 0.01)
    write_png(tmp_path / "x.png", codes)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "x.png")), codes)
    frames = [codes, codes[::-1].copy(), codes[:, ::-1].copy()]
    write_gif(tmp_path / "x.gif", frames)
    with Image.open(tmp_path / "x.gif") as image:
        assert image.n_frames == 3
        assert image.info["loop"] == 0
        image.seek(1)
        shown = np.asarray(image.convert("RGB")).astype(int)
    assert np.abs(shown - frames[1]).mean() < 8.0
    assert {path.name for path in tmp_path.iterdir()} == {"x.exr", "x.png", "x.gif"}


def test_unwritable_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write_png(tmp_path / "none" / "x.png", np.zeros((2, 2, 3), np.uint8))


@pytest.mark.parametrize(
    ("name", "moving", "complaint"),
    [
        ("x.jpg", False, "expected .png or .exr"),
        ("x.gif", False, "give --turntable N"),
        ("x.png", True, "is no .gif"),
    ],
)
def test_names_of_other_kinds(name: str, moving: bool, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        check_output(name, moving)
