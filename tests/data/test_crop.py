"""Cropping of UBO2003 pictures along JPEG blocks."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch.data import ReadOptions, load_btf
from spmm_torch.data.crop import crop_jpeg, crop_ubo2003
from spmm_torch.errors import DataError


def smooth_jpeg(size: int = 32, subsampling: int = 0) -> bytes:
    ramp = np.linspace(40, 200, size)
    pixels = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None], 120.0), -1)
    buffer = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(
        buffer, "JPEG", quality=85, subsampling=subsampling
    )
    return buffer.getvalue()


def decoded(payload: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(payload)).convert("RGB"), dtype=int)


def write_source(path: Path, payload: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for light in (0, 15):
            name = f"OLD/MANYFILES/tv000_pv000/0 tl{light:03} pl000 tv000 pv000.jpg"
            archive.writestr(name, payload)
    return path


@pytest.mark.parametrize("subsampling", [0, 2])
def test_crop_keeps_pixels_and_tables(subsampling: int) -> None:
    payload = smooth_jpeg(48, subsampling)
    cut = crop_jpeg(payload, (16, 16, 32, 48), "a.jpg")
    difference = decoded(cut) - decoded(payload)[16:48, 16:32]
    inner = difference[1:-1, 1:-1] if subsampling else difference  # colour is smoothed over edges
    assert np.abs(inner).max() <= 3
    tables = [Image.open(io.BytesIO(data)).quantization for data in (payload, cut)]
    assert tables[0] == tables[1]


def test_zip(tmp_path: Path) -> None:
    source = write_source(tmp_path / "old.zip", smooth_jpeg())
    crop_ubo2003(source, 8, 16, 16, 8, tmp_path / "NEW.zip")
    btf = load_btf(tmp_path / "NEW.zip", gamma=1.0)
    assert (btf.height, btf.width, btf.pair_count) == (8, 16, 2)
    expected = load_btf(source, gamma=1.0).picture(0, 1)[16:24, 8:24]
    assert (btf.picture(0, 1) - expected).abs().max() < 4 / 255
    with zipfile.ZipFile(tmp_path / "NEW.zip") as archive:
        assert all(name.startswith("NEW/MANYFILES/tv000_pv000/") for name in archive.namelist())


def test_names_by_a_pattern(tmp_path: Path) -> None:
    """What is not named as UBO2003 does is cut too, and keeps its names."""
    names = [f"W/L{light}_0_V0_0.jpg" for light in (0, 15)]
    with zipfile.ZipFile(tmp_path / "old.zip", "w") as archive:
        for name in names:
            archive.writestr(name, smooth_jpeg())
    target, pattern = tmp_path / "NEW.zip", "L{tl}_{pl}_V{tv}_{pv}"
    with pytest.raises(DataError, match="--pattern"):
        crop_ubo2003(tmp_path / "old.zip", 8, 16, 16, 8, target)
    crop_ubo2003(tmp_path / "old.zip", 8, 16, 16, 8, target, pattern=pattern)
    btf = load_btf(target, ReadOptions(pattern=pattern))
    assert (btf.height, btf.width, btf.pair_count) == (8, 16, 2)


def test_a_turned_jpeg_is_not_cut_as_if_it_were_upright(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 8
    buffer = io.BytesIO()
    Image.new("RGB", (32, 32)).save(buffer, "JPEG", exif=exif)
    source = write_source(tmp_path / "old.zip", buffer.getvalue())
    with pytest.raises(DataError, match="is turned by its EXIF tag"):
        crop_ubo2003(source, 0, 0, 16, 16, tmp_path / "new.zip")
    assert [file.name for file in tmp_path.iterdir()] == ["old.zip"]


def test_bad_rectangles(tmp_path: Path) -> None:
    source = write_source(tmp_path / "old.zip", smooth_jpeg())
    for box in ((4, 0, 8, 8), (0, 0, 12, 8), (24, 0, 16, 8), (-8, 0, 8, 8), (0, 0, 0, 8)):
        with pytest.raises(DataError, match="rectangle"):
            crop_ubo2003(source, *box, tmp_path / "new.zip")
    assert [file.name for file in tmp_path.iterdir()] == ["old.zip"]
