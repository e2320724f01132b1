"""Parts of a BTF: each reader gives the same slice of the whole, and decodes no more than that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, Selection, load_btf
from spmm_torch.data.ubo2014 import write_ubo2014
from spmm_torch.errors import DataError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.pictures import encode_png, random_codes, write_pictures

PARTS = [
    Selection(crop=(1, 2, 3, 2)),
    Selection(texels=6),
    Selection(directions="views=1,3;lights=0,2"),
    Selection(crop=(1, 0, 4, 5), texels=9, directions="views=0-2;lights=1"),
]


def check_parts(path: Path) -> None:
    """Every part is the same slice of the whole."""
    whole = load_btf(path)
    values = whole.texels().view(-1, len(whole.view), len(whole.light), 3)  # [T, V, L, C]
    for selection in PARTS:
        part = load_btf(path, selection=selection, seed=2)
        texels, views, lights = (
            torch.arange(count) if index is None else index
            for index, count in zip(
                (part.part.texels, part.part.views, part.part.lights),
                values.shape[:3],
                strict=True,
            )
        )
        expected = values[texels][:, views][:, :, lights].flatten(1, 2)
        assert torch.equal(part.texels(), expected)
        assert torch.equal(part.texels(torch.tensor([4, 0])), expected[[4, 0]])
        last = expected[:, -1].view(part.height, part.width, 3)
        assert torch.equal(part.picture(len(views) - 1, len(lights) - 1), last)
        assert part.is_hdr == bool(expected.max() > 1)
        assert part.raw_bytes == round(expected.numel() * whole.bytes_per_value)


def test_parts_of_picture_sets(picture_set: Path) -> None:
    check_parts(picture_set)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, ">f4"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_parts_of_npz(tmp_path: Path, dtype: str, order: str, save: Callable) -> None:
    directions = ring_directions().numpy()
    values = np.random.default_rng(0).gamma(1.0, 2.0, (4, 3, 5, 6, 3))
    arrays = {"view": directions[:4], "light": directions[5:8]}
    save(tmp_path / "a.npz", values=np.asarray(values, dtype=dtype, order=order), **arrays)
    check_parts(tmp_path / "a.npz")


@pytest.mark.parametrize("variant", ["DFMF08FC", "FMF06FC", "FMF12FCE"])
def test_parts_of_ubo2014(tmp_path: Path, variant: str) -> None:
    directions = ring_directions()
    values = np.random.default_rng(0).gamma(1.0, 2.0, (4, 3, 5, 6, 3)).astype(np.float32)
    btf = BTF.from_values(values, directions[:4], directions[5:8])
    write_ubo2014(tmp_path / "a.btf", btf, components=5, variant=variant)
    check_parts(tmp_path / "a.btf")


def test_a_part_decodes_no_more_than_itself(tmp_path: Path) -> None:
    broken = {(1, 0): b"broken", (2, 2): b"broken"}
    path = write_pictures(
        tmp_path / "a.zip", random_codes("uint8", (3, 3, 2, 2)), encode_png, ".png", broken
    )
    assert load_btf(path, selection=Selection(directions="views=0,2;lights=0,1")).texels().numel()
    with pytest.raises(DataError, match="cannot be read"):
        load_btf(path, selection=Selection(directions="views=1")).texels()
