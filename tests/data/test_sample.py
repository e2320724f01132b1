"""The bundled sample, and the zips it and the figures come from where they are at hand."""

from __future__ import annotations

import io
import math
import zipfile

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.data import load_btf, named_pictures, sample_path
from spmm_torch.geometry.directions import ring_directions
from tests.locations import DATA, needs_data


def test_bundled_sample() -> None:
    path = sample_path()
    assert path.stat().st_size <= 12_000_000
    assert (path.parent / "README.md").is_file()
    btf = load_btf(path)
    assert (btf.name, btf.height, btf.width, btf.pair_count) == ("WEAVE40", 40, 40, 6561)
    torch.testing.assert_close(btf.view, ring_directions(), atol=1e-6, rtol=0)
    values = btf.texels(slice(0, 40))
    assert 0.0 <= values.min() < values.max() <= 1.0


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=needs_data(f"{name}.zip"))
        for name in ("ROCKS64", "TILES64", "MOSS64", "WEAVE64")
    ],
)
def test_path_traced_materials(name: str) -> None:
    btf = load_btf(DATA / f"{name}.zip")
    assert (btf.name, btf.height, btf.width, btf.pair_count) == (name, 64, 64, 6561)
    torch.testing.assert_close(btf.light, ring_directions(), atol=1e-6, rtol=0)


@needs_data("WEAVE64.zip")
def test_sample_is_a_crop_of_its_source() -> None:
    source = DATA / "WEAVE64.zip"
    names = named_pictures.list_pictures(source)[::500]
    squared = []
    with zipfile.ZipFile(source) as whole, zipfile.ZipFile(sample_path()) as part:
        for name in names:
            cut = part.read(name.replace("WEAVE64", "WEAVE40"))
            a, b = (
                np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=float)
                for picture in (whole.read(name), cut)
            )
            squared.append(np.square(a[:40, :40] - b).mean())
    assert 10 * math.log10(255.0**2 / max(np.mean(squared), 1e-9)) > 50.0
