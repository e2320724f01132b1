"""UBO2003 zips: PNGs hold the very codes, JPEGs are near, and nothing is clamped."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, JpegImagePlugin

from spmm_torch.data import BTF, load_btf, sample_path
from spmm_torch.data.crop import crop_ubo2003
from spmm_torch.data.expansion import TableExpansion
from spmm_torch.data.writers import write_ubo2003
from spmm_torch.data.writers.ubo2003 import _codes
from spmm_torch.errors import ConfigError, OutputError
from tests.planted.btfs import picture_btf


@pytest.fixture
def btf(values: np.ndarray) -> BTF:
    """Values that 8-bit codes of gamma 2.2 stand for."""
    codes = np.rint(values * 255).astype(np.uint8)
    return picture_btf(TableExpansion.gamma(2.2).table.numpy()[codes])


def test_png_holds_the_values(tmp_path: Path, btf: BTF) -> None:
    calls: list[tuple[int, int]] = []
    path = tmp_path / "WOOL.zip"
    write_ubo2003(path, btf, format="png", progress=lambda *call: calls.append(call))
    assert calls == [(1, 2), (2, 2)]
    found = load_btf(path)
    assert (found.name, found.height, found.width) == ("WOOL", btf.height, btf.width)
    torch.testing.assert_close(found.view, btf.view, atol=1e-6, rtol=0)
    torch.testing.assert_close(found.light, btf.light, atol=1e-6, rtol=0)
    assert torch.equal(found.texels(), btf.texels())
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert names[0].startswith("WOOL/MANYFILES/tv000_pv000/00000 tl075 pl315 ")
    assert all(name.endswith(".png") for name in names)


def test_same_bytes_each_time(tmp_path: Path, btf: BTF) -> None:
    for format in ("png", "jpeg"):
        (tmp_path / format).mkdir()
        for folder in (tmp_path, tmp_path / format):
            write_ubo2003(folder / "a.zip", btf, format=format)
        assert (tmp_path / "a.zip").read_bytes() == (tmp_path / format / "a.zip").read_bytes()


def test_sample_as_png_is_the_sample(tmp_path: Path) -> None:
    crop_ubo2003(sample_path(), 8, 16, 8, 8, tmp_path / "a.zip")
    source = load_btf(tmp_path / "a.zip")
    write_ubo2003(tmp_path / "b.zip", source, format="png")
    assert torch.equal(load_btf(tmp_path / "b.zip").texels(), source.texels())


@given(st.floats(0.3, 4.0))
def test_codes_survive_any_gamma(gamma: float) -> None:
    every = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=-1)
    np.testing.assert_array_equal(
        _codes(TableExpansion.gamma(gamma).table.numpy()[every], gamma, "a"), every
    )


def test_jpeg_is_near_and_keeps_colour(tmp_path: Path) -> None:
    ramp = np.linspace(0.1, 0.9, 32, dtype=np.float32)
    colors = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None], ramp[::-1, None]), -1)
    source = picture_btf(np.broadcast_to(colors, (1, 2, 32, 32, 3)).copy())
    error = {}
    for quality in (60, 95):
        write_ubo2003(tmp_path / "a.zip", source, quality=quality)
        difference = load_btf(tmp_path / "a.zip").texels() - source.texels()
        error[quality] = float(difference.abs().max())
    assert error[95] < 0.03 < error[60] < 0.2
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        payload = archive.read(archive.namelist()[0])
    with Image.open(io.BytesIO(payload)) as image:
        assert image.format == "JPEG"
        assert JpegImagePlugin.get_sampling(image) == 0  # 4:4:4


@pytest.mark.parametrize("value", [1.01, 3.7e4])
def test_nothing_is_clamped(tmp_path: Path, values: np.ndarray, value: float) -> None:
    values[1, 2, 3, 4, 0] = value
    with pytest.raises(OutputError, match=r"tv030 pv000.jpg' would hold .*write EXR or NPZ"):
        write_ubo2003(tmp_path / "a.zip", picture_btf(values))
    assert not list(tmp_path.iterdir())


def test_rounding_above_one_is_no_clamping(tmp_path: Path, values: np.ndarray) -> None:
    values[1, 2, 3, 4, 0] = np.nextafter(np.float32(1.0), np.float32(2.0))
    write_ubo2003(tmp_path / "a.zip", picture_btf(values), format="png")
    assert load_btf(tmp_path / "a.zip").texels().max() == 1.0


@pytest.mark.parametrize("value", [-0.01, np.nan, np.inf])
def test_values_that_are_none(value: float) -> None:
    picture = np.full((2, 2, 3), 0.5, dtype=np.float32)
    picture[1, 0, 2] = value
    with pytest.raises(OutputError, match="expected 0 to 1"):
        _codes(picture, 2.2, "a")


def test_names_that_would_be_hidden(tmp_path: Path, btf: BTF) -> None:
    write_ubo2003(tmp_path / ".a.zip", btf)
    assert load_btf(tmp_path / ".a.zip").pair_count == btf.pair_count


def test_options(tmp_path: Path, btf: BTF) -> None:
    for options, message in (
        ({"gamma": 0.0}, "gamma"),
        ({"format": "gif"}, "format is 'gif'; expected one of jpeg, png"),
        ({"quality": 0}, "quality is 0"),
        ({"quality": 101}, "quality is 101"),
    ):
        with pytest.raises(ConfigError, match=message):
            write_ubo2003(tmp_path / "a.zip", btf, **options)
    assert not list(tmp_path.iterdir())


def test_full_disk(tmp_path: Path, values: np.ndarray, full_disk: Callable) -> None:
    source = picture_btf(np.tile(values, (1, 1, 20, 20, 1)))
    with full_disk(50_000), pytest.raises(OutputError, match="cannot be written"):
        write_ubo2003(tmp_path / "a.zip", source)
    assert not list(tmp_path.iterdir())
