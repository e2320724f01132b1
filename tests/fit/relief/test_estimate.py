"""Planted reliefs are found, what does not pay is exactly None, and bad input is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from spmm_torch import BTF, load_btf
from spmm_torch.data import ubo2014
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.fit.relief import estimate_relief
from spmm_torch.fit.relief.drift import without_plane
from spmm_torch.fit.relief.estimate import one_byte
from spmm_torch.fit.relief.given import best_scale, read_heights, stored_heights
from spmm_torch.fit.relief.pictures import chosen_views, shift_of_height
from spmm_torch.fit.relief.search import Search
from spmm_torch.geometry.directions import ring_directions
from tests.planted.palettes import strewn_palettes
from tests.planted.reliefs import RINGS, PlantedRelief, planted_relief

VIEWS = sum(count for _, count in RINGS)


def correlation(left: Tensor, right: Tensor) -> float:
    return float(torch.corrcoef(torch.stack((left.flatten(), right.flatten())))[0, 1])


def random_drift(reach: float, count: int = VIEWS) -> Tensor:
    generator = torch.Generator().manual_seed(3)
    return reach * (2.0 * torch.rand(count, 2, generator=generator) - 1.0)


def drift_error(planted: PlantedRelief, found: Tensor | None) -> Tensor:
    """Distance `[V]` in texels of a drift from the planted one, beside what a plane explains."""
    assert found is not None
    rows, columns = planted.height.shape
    steep = torch.zeros(len(planted.btf.view), dtype=torch.bool)
    steep[chosen_views(planted.btf)] = True
    slope = shift_of_height(planted.btf.view) * columns
    truth, _ = without_plane(planted.drift, slope, steep)
    return (found * torch.tensor([columns, -rows]) - truth).norm(dim=1)


@pytest.fixture(scope="module")
def relief() -> PlantedRelief:
    return planted_relief()


@pytest.mark.parametrize("periodic", [True, False])
def test_planted_heights_are_found(periodic: bool) -> None:
    planted = planted_relief(periodic=periodic)
    found = estimate_relief(planted.btf)
    assert isinstance(found.height, Tensor)
    assert correlation(found.height, planted.height) > 0.97
    assert float(found.height.mean()) == pytest.approx(float(planted.height.mean()), abs=0.001)
    assert found.drift is None
    assert found.rule == ("repeat" if periodic else "mirror")


@pytest.mark.parametrize(("plane", "periodic"), [(0.043, True), (0.11, True), (-0.03, False)])
def test_a_planted_plane_is_found_to_2_percent_and_nothing_else(
    plane: float, periodic: bool
) -> None:
    found = estimate_relief(planted_relief(0.0, plane, periodic=periodic).btf)
    assert found.height == pytest.approx(plane, rel=0.02)
    assert found.drift is None


@pytest.mark.parametrize(("texture", "noise"), [(0.5, 0.0), (0.5, 0.3), (0.0, 0.1)])
def test_a_flat_surface_has_no_relief(texture: float, noise: float) -> None:
    found = estimate_relief(planted_relief(0.0, 0.0, texture=texture, noise=noise).btf)
    assert found.height is None
    assert found.drift is None
    assert "flat" in found.lines[0]


@pytest.mark.parametrize("reach", [2.0, 0.3])
def test_planted_drift_is_found(reach: float) -> None:
    planted = planted_relief(drift=random_drift(reach))
    found = estimate_relief(planted.btf)
    assert float(drift_error(planted, found.drift).max()) < 0.1
    assert isinstance(found.height, Tensor)
    assert correlation(found.height, planted.height) > 0.96


def test_drift_of_a_flat_surface_leaves_it_flat() -> None:
    planted = planted_relief(0.0, 0.0, random_drift(2.0))
    found = estimate_relief(planted.btf)
    assert float(drift_error(planted, found.drift).max()) < 0.1
    assert found.height is None


def test_grazing_views_drift_too() -> None:
    view = ring_directions((*RINGS, (72.0, 6)))
    planted = planted_relief(0.0, 0.03, random_drift(1.5, len(view)), views=view)
    error = drift_error(planted, estimate_relief(planted.btf).drift)
    assert float(error[:VIEWS].max()) < 0.1
    assert float(error[VIEWS:].max()) < 0.25


def test_modes(relief: PlantedRelief) -> None:
    plane = estimate_relief(relief.btf, mode="plane")
    assert plane.height == pytest.approx(0.03, rel=0.1)
    assert set(plane.left) == {"plane"}
    off = estimate_relief(relief.btf, mode="off")
    assert off.height is None and off.drift is None and off.lines == ()
    with pytest.raises(ConfigError, match=r"relief\.mode is 'deep'"):
        estimate_relief(relief.btf, mode="deep")


def test_drift_can_be_taken_as_exact() -> None:
    assert estimate_relief(planted_relief(drift=random_drift(2.0)).btf, drift="off").drift is None


def test_few_lights_and_missing_pictures_do_not_matter() -> None:
    planted = planted_relief(lights=ring_directions(((30.0, 3),)))
    missing = torch.zeros(len(planted.btf.view), 3, dtype=torch.bool)
    missing[::5, 1] = True
    found = estimate_relief(replace(planted.btf, missing=missing))
    assert isinstance(found.height, Tensor)
    assert correlation(found.height, planted.height) > 0.95
    single = estimate_relief(planted_relief(lights=ring_directions(((30.0, 1),))).btf)
    assert isinstance(single.height, Tensor)


@pytest.mark.parametrize(
    ("views", "size", "words"),
    [(1, (16, 16), "there is only one"), (9, (4, 40), "40 x 4 texels are too few")],
)
def test_where_no_relief_can_be_found_it_is_said(
    views: int, size: tuple[int, int], words: str
) -> None:
    view = ring_directions(((0.0, 1), (30.0, 8)))[:views]
    values = torch.rand(views, 2, *size, 3, generator=torch.Generator().manual_seed(0))
    btf = BTF.from_values(values, view, ring_directions(((20.0, 2),)))
    found = estimate_relief(btf)
    assert found.height is None and found.drift is None
    assert words in found.lines[0]


def test_pictures_without_texture_have_no_relief() -> None:
    view = ring_directions(RINGS)
    values = torch.full((len(view), 2, 16, 16, 3), 0.25)
    found = estimate_relief(BTF.from_values(values, view, ring_directions(((20.0, 2),))))
    assert found.height is None
    assert "no texture" in found.lines[0]


def test_a_given_map_is_put_where_it_fits(relief: PlantedRelief, tmp_path: Path) -> None:
    low, high = relief.height.aminmax()
    codes = (relief.height - low) / (high - low) * 65535.0
    Image.fromarray(codes.numpy().astype(np.uint16)).save(tmp_path / "H.png")
    found = estimate_relief(relief.btf, height=tmp_path / "H.png")
    assert isinstance(found.height, Tensor)
    assert float(found.height.std()) == pytest.approx(0.02, rel=0.15)
    told = estimate_relief(
        relief.btf, height=tmp_path / "H.png", height_scale=float(high - low)
    ).height
    assert isinstance(told, Tensor)
    assert float((told - relief.height).abs().max()) < 0.002


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_depths_are_told_from_heights(relief: PlantedRelief, sign: float) -> None:
    search = Search.open(relief.btf, "cpu")
    low, high = relief.height.aminmax()
    shape = (relief.height - low) / (high - low)
    scale, _ = best_scale(search.sought, sign * shape)
    assert scale == pytest.approx(sign * float(high - low), rel=0.2)


def test_the_map_of_a_btf_file_is_the_start(
    relief: PlantedRelief, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ubo2014.write_ubo2014(tmp_path / "A.btf", relief.btf, variant="FMF12FCE", components=40)
    btf = load_btf(tmp_path / "A.btf")
    assert stored_heights(btf) is None
    header = ubo2014.read_header(tmp_path / "A.btf")

    def carry(height: Tensor) -> None:
        codes = height.numpy().astype(np.float16).view(np.uint16)
        monkeypatch.setattr(ubo2014, "read_header", lambda *_: replace(header, height_map=codes))

    carry(7.0 * relief.height + 2.0)
    shape = stored_heights(btf)
    assert shape is not None
    assert correlation(shape, relief.height) > 0.999
    part = btf.restricted(torch.arange(48 * 16), (16, 48))
    assert torch.equal(stored_heights(part), shape[:16])
    found = estimate_relief(btf)
    assert isinstance(found.height, Tensor)
    assert correlation(found.height, relief.height) > 0.97
    carry(torch.full((48, 48), float("nan")))
    assert stored_heights(btf) is None
    carry(torch.zeros(4, 4))
    assert stored_heights(btf) is None


def test_a_map_of_another_size_is_refused(relief: PlantedRelief, tmp_path: Path) -> None:
    Image.fromarray(np.zeros((8, 9), np.uint8)).save(tmp_path / "H.png")
    with pytest.raises(DataError, match=r"9 x 8 but the pictures of the BTF are 48 x 48"):
        estimate_relief(relief.btf, height=tmp_path / "H.png")


def test_a_map_with_nan_is_refused(tmp_path: Path) -> None:
    Image.fromarray(np.full((8, 8), np.nan, np.float32)).save(tmp_path / "H.tiff")
    with pytest.raises(DataError, match=r"H\.tiff has values from nan"):
        read_heights(tmp_path / "H.tiff", 8, 8)


def test_heights_fit_into_one_byte() -> None:
    height = torch.rand(20, 20, generator=torch.Generator().manual_seed(0))
    rounded = one_byte(height)
    assert len(rounded.unique()) <= 256
    assert float((rounded - height).abs().max()) <= 0.5 / 255 + 1e-6
    assert torch.allclose(one_byte(rounded), rounded, atol=1e-7)
    flat = torch.full((3, 3), 0.25)
    assert torch.equal(one_byte(flat), flat)


@pytest.mark.parametrize("seed", range(4))
def test_flat_neighbours_of_other_mixtures_have_no_relief(seed: int) -> None:
    """Heights that let them agree by chance do so under lights that they were not found under."""
    assert estimate_relief(strewn_palettes(16, 8, seed)[0]).height is None
