"""What each kind of mask selects, and what it refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch import SPMM, ConfigError, DataError
from spmm_torch.edit import (
    Rectangle,
    Stripes,
    cluster_selection,
    colour_selection,
    lobe_group,
    lobe_selection,
    picture_selection,
    widths,
)

UP = torch.tensor([0.0, 0.0, 1.0])


def test_rectangle(model: SPMM) -> None:
    mask = Rectangle(x=2, y=1, width=3, height=4).mask(model)
    rows, columns = torch.nonzero(mask, as_tuple=True)
    assert (int(rows.min()), int(rows.max())) == (1, 4)
    assert (int(columns.min()), int(columns.max())) == (2, 4)
    assert float(mask.sum()) == 12.0


@pytest.mark.parametrize(
    ("codes", "suffix", "expected"),
    [
        (np.full((8, 8), 32768, np.uint16), ".png", 32768 / 65535),
        (np.full((8, 8), 32768, np.uint16), ".tif", 32768 / 65535),
        (np.full((8, 8), 0.5, np.float32), ".tif", 0.5),
    ],
    ids=["16-bit png", "16-bit tiff", "float tiff"],
)
def test_pictures_of_more_than_8_bits(
    model: SPMM, tmp_path: Path, codes: np.ndarray, suffix: str, expected: float
) -> None:
    Image.fromarray(codes).save(tmp_path / f"mask{suffix}")
    where = picture_selection(model, tmp_path / f"mask{suffix}").texels
    torch.testing.assert_close(where, torch.full_like(where, expected))


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.full((8, 8), 1, np.int32), "32-bit int32 numbers, whose white is not known"),
        (np.full((8, 8), 255.0, np.float32), "has values from 255 to 255; expected 0 to 1"),
    ],
)
def test_pictures_whose_white_is_not_known(
    model: SPMM, tmp_path: Path, picture: np.ndarray, message: str
) -> None:
    Image.fromarray(picture).save(tmp_path / "mask.tif")
    with pytest.raises(DataError, match=message):
        picture_selection(model, tmp_path / "mask.tif")


@pytest.mark.parametrize("place", [(6, 0, 3, 1), (0, 8, 1, 1), (-1, 0, 2, 2)])
def test_rectangle_outside(model: SPMM, place: tuple[int, int, int, int]) -> None:
    with pytest.raises(ConfigError, match="reaches out of the texture; expected columns 0 to 7"):
        Rectangle(*place).mask(model)


def test_white_of_a_computed_colour_is_white(model: SPMM, tmp_path: Path) -> None:
    """White as X, Y, Z came back as 1.00001, and was refused."""
    Image.fromarray(np.full((8, 8), 1.00001, np.float32)).save(tmp_path / "mask.tif")
    assert bool((picture_selection(model, tmp_path / "mask.tif").texels == 1.0).all())


def test_stripes(model: SPMM) -> None:
    hard = Stripes(count=2, share=0.5).mask(model)
    assert hard[0].tolist() == [0, 1, 1, 0, 0, 1, 1, 0]
    assert torch.equal(hard, Stripes(count=2, share=0.5, vertical=False).mask(model).T)
    soft = Stripes(count=1, share=0.5, soft=0.5).mask(model)[0]
    assert soft.tolist() == [0.125, 0.375, 0.625, 0.875, 0.875, 0.625, 0.375, 0.125]
    with pytest.raises(ConfigError, match="expected a count of at least 1"):
        Stripes(count=0).mask(model)


def test_picture(model: SPMM, tmp_path: Path) -> None:
    codes = np.arange(64, dtype=np.uint8).reshape(8, 8) * 4
    Image.fromarray(codes).save(tmp_path / "mask.png")
    where = picture_selection(model, tmp_path / "mask.png")
    torch.testing.assert_close(where.texels, torch.from_numpy(codes.flatten() / 255.0).float())
    white = np.full((8, 8, 3), 255, np.uint8)
    Image.fromarray(white).save(tmp_path / "white.png")
    assert (picture_selection(model, tmp_path / "white.png").texels == 1.0).all()
    Image.fromarray(codes[:, :5]).save(tmp_path / "narrow.png")
    with pytest.raises(ConfigError, match="the mask has 5 x 8 texels, the texture 8 x 8"):
        picture_selection(model, tmp_path / "narrow.png")
    (tmp_path / "text.png").write_text("no picture")
    for name in ("text.png", "missing.png"):
        with pytest.raises(DataError, match=f"{name} cannot be read .* such as a PNG"):
            picture_selection(model, tmp_path / name)


def test_cluster(model: SPMM) -> None:
    where = cluster_selection(model, [1])
    assert torch.equal(where.texels > 0.0, model.labels == 1)
    assert bool((cluster_selection(model, [0, 1]).texels == 1.0).all())
    with pytest.raises(ConfigError, match="cluster 2 does not exist; expected 0 to 1"):
        cluster_selection(model, [0, 2])


def test_colour_range(model: SPMM) -> None:
    red = model.picture(UP, UP)[..., 0].flatten().detach()
    limit = red.median().item()
    big = [1e3] * 3
    where = colour_selection(model, UP, UP, [limit, -1e3, -1e3], big)
    assert torch.equal(where.texels > 0.0, red >= limit)
    soft = colour_selection(model, UP, UP, [limit, -1e3, -1e3], big, soft=0.2)
    expected = (1.0 - (limit - red) / 0.2).clamp(0.0, 1.0)
    torch.testing.assert_close(soft.texels, expected.detach())
    for low, high in (([0.0] * 2, [1.0] * 2), ([1.0] * 3, [0.0] * 3), ([0.0] * 3, [1.0])):
        with pytest.raises(ConfigError, match="expected 3 numbers each, the lower ones first"):
            colour_selection(model, UP, UP, low, high)


def test_lobe_properties(model: SPMM) -> None:
    lobes = model.dictionary
    specular, other = (lobe_group(model, name).lobes for name in ("specular", "non_specular"))
    for found, expected in (
        (lobe_selection(model, specular=True), specular),
        (lobe_selection(model, specular=False), other),
        (lobe_selection(model, width=(0.0, 0.3)), widths(lobes) <= 0.3),
        (
            lobe_selection(model, elevation=(math.radians(85.0), math.pi / 2.0)),
            torch.arcsin(lobes.normal[:, 2]) >= math.radians(85.0),
        ),
        (
            lobe_selection(model, models=["ward", "lafortune"], specular=True),
            torch.tensor([name in ("ward", "lafortune") for name in lobes.names()]) & specular,
        ),
    ):
        assert torch.equal(found.entries > 0.0, expected[model.index])
        assert bool(expected.any())
        assert not bool(expected.all())
        assert found.texels is None
    with pytest.raises(ConfigError, match="unknown BRDF wart"):
        lobe_selection(model, models=["wart"])
