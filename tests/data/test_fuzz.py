"""Damaged zips and NPZ files: a clear error or a valid read, never a crash or a huge allocation."""

from __future__ import annotations

import io
import resource
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from spmm_torch.data import load_btf
from spmm_torch.errors import SPMMError

ANGLES = ((0, 0), (30, 90))
# More address space than this, on top of what the process has, is a huge allocation.
ALLOWED = 1 << 30
VALUES = np.random.default_rng(0).random((2, 2, 3, 4, 3), dtype=np.float32)
DIRECTIONS = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]], np.float32)


def picture_zip(kind: str, compression: int) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for view, (tv, pv) in enumerate(ANGLES):
            for light, (tl, pl) in enumerate(ANGLES):
                picture = io.BytesIO()
                codes = (VALUES[view, light] * 255).astype(np.uint8)
                Image.fromarray(codes).save(picture, kind)
                name = f"A/tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.{kind.lower()}"
                archive.writestr(name, picture.getvalue())
    return buffer.getvalue()


def npz(save: Callable) -> bytes:
    buffer = io.BytesIO()
    save(buffer, values=VALUES, view=DIRECTIONS, light=DIRECTIONS)
    return buffer.getvalue()


SEEDS = {
    "JPEG": picture_zip("JPEG", zipfile.ZIP_STORED),
    "PNG": picture_zip("PNG", zipfile.ZIP_DEFLATED),
    "NPZ": npz(np.savez),
    "compressed NPZ": npz(np.savez_compressed),
}


def check(content: bytes, folder: Path) -> None:
    """A valid read, or an error that a user can mend."""
    path = folder / "a.zip"
    path.write_bytes(content)
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ALLOWED, before[1]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's about EXIF and the like
            values = load_btf(path, threads=1).texels()
        assert values.isfinite().all()
        assert (values >= 0.0).all()
    except SPMMError as error:
        assert str(error).endswith(".")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("kind", SEEDS)
def test_whole_files_are_read(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.zip").write_bytes(SEEDS[kind])
    assert load_btf(tmp_path / "a.zip").texels().shape == (12, 4, 3)


@pytest.mark.parametrize("kind", SEEDS)
def test_truncated_anywhere(tmp_path: Path, kind: str) -> None:
    content = SEEDS[kind]
    for length in range(0, len(content), 7):
        check(content[:length], tmp_path)


@pytest.mark.parametrize("kind", SEEDS)
@settings(max_examples=500, deadline=None)
@given(data=st.data())
def test_changed_bytes(
    tmp_path_factory: pytest.TempPathFactory, kind: str, data: st.DataObject
) -> None:
    content = bytearray(SEEDS[kind])
    places = st.integers(0, len(content) - 1)
    for place in data.draw(st.lists(places, min_size=1, max_size=6)):
        content[place] = data.draw(st.integers(0, 255))
    check(bytes(content), tmp_path_factory.getbasetemp())
