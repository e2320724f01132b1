"""Which part of a BTF a selection takes, and what it says of one that is not there."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.data import BTF, Selection, select_part
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.geometry.directions import ring_directions

RINGS = torch.tensor([1, 6, 12, 18, 20, 24])  # directions at 0, 15, 30, 45, 60, 75 degrees
NUMBERS = torch.arange(81)


def blank(height: int, width: int, view: Tensor | None = None, light: Tensor | None = None) -> BTF:
    """A BTF that cannot be decoded."""

    def refuse(*_: object) -> None:
        raise AssertionError("decoded")

    directions = ring_directions()
    view, light = (directions if side is None else side for side in (view, light))
    return BTF("blank", "", height, width, view, light, 1, refuse)


def counted(height: int, width: int) -> BTF:
    """A BTF whose values are the numbers of its texels (red), views (green) and lights (blue)."""
    directions = ring_directions()[[0, 1, 7, 20]]
    values = np.zeros((4, 4, height, width, 3), np.float32)
    values[..., 0] = np.arange(height * width).reshape(height, width)
    values[..., 1] = np.arange(4)[:, None, None, None]
    values[..., 2] = np.arange(4)[:, None, None]
    return BTF.from_values(values, directions, directions)


def texel_numbers(btf: BTF) -> Tensor:
    """Numbers in the source of all texels of a `counted` BTF, as a picture `[H, W]`."""
    return btf.picture(0, 0)[..., 0].long()


def test_nothing_is_chosen() -> None:
    btf = blank(3, 4)
    assert select_part(btf, Selection()).part.is_whole


def test_crop() -> None:
    part = select_part(counted(6, 9), Selection(crop=(2, 1, 4, 3)))
    expected = torch.arange(54).view(6, 9)[1:4, 2:6]
    assert (part.height, part.width) == (3, 4)
    assert torch.equal(texel_numbers(part), expected)
    whole = select_part(counted(6, 9), Selection(crop=(0, 0, 9, 6)))
    assert torch.equal(whole.texels(), counted(6, 9).texels())


@pytest.mark.parametrize(
    "crop", [(-1, 0, 2, 2), (0, -1, 2, 2), (8, 0, 2, 2), (0, 5, 2, 2), (0, 0, 0, 1), (0, 0, 1, 0)]
)
def test_crop_outside(crop: tuple[int, ...]) -> None:
    with pytest.raises(DataError, match="does not lie inside the pictures of blank") as error:
        select_part(blank(6, 9), Selection(crop=crop))
    assert "9 x 6" in str(error.value) and ",".join(map(str, crop)) in str(error.value)


def test_crop_of_other_than_four_numbers() -> None:
    for crop in ((1, 2, 3), (1, 2, 3, 4, 5), ()):
        with pytest.raises(ConfigError, match="expected x0,y0,width,height"):
            select_part(blank(6, 9), Selection(crop=crop))


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.0, 1.1), st.integers(0, 2**31))
@example(40, 2, 0.55, 0)  # one column would be too few
def test_one_texel_of_each_cell(height: int, width: int, fraction: float, seed: int) -> None:
    count = max(int(fraction * height * width), 1)
    part = select_part(blank(height, width), Selection(texels=count), seed)
    if count >= height * width:
        assert part.part.is_whole
        return
    # As many as asked for, up to half a row of the shorter side.
    assert abs(part.texel_count - count) <= max(min(part.height, part.width) / 2, 0.5)
    rows, columns = np.divmod(part.part.texels.view(part.height, part.width).numpy(), width)
    for row in range(part.height):
        top, bottom = row * height // part.height, (row + 1) * height // part.height
        assert ((rows[row] >= top) & (rows[row] < bottom)).all()
    for column in range(part.width):
        left, right = column * width // part.width, (column + 1) * width // part.width
        assert ((columns[:, column] >= left) & (columns[:, column] < right)).all()
    # Cells are about as high as they are wide, where the picture allows it.
    if part.height > 1 and part.width > 1:
        ratio = (height / part.height) / (width / part.width)
        assert 1 / 3 <= ratio <= 3


def test_choice_of_texels_is_the_seeds() -> None:
    def chosen(seed: int) -> Tensor:
        return select_part(blank(32, 32), Selection(texels=64), seed).part.texels

    assert torch.equal(chosen(3), chosen(3))
    assert len({tuple(chosen(seed).tolist()) for seed in range(8)}) == 8
    everywhere = torch.cat([chosen(seed) for seed in range(200)]).bincount(minlength=1024)
    assert everywhere.min() > 0  # each texel of a cell may be the one


def test_every_texel_in_place() -> None:
    part = select_part(counted(6, 9), Selection(texels=24), seed=1)
    assert torch.equal(texel_numbers(part).flatten(), part.part.texels)


@pytest.mark.parametrize("texels", [0, -5])
def test_no_texels(texels: int) -> None:
    with pytest.raises(ConfigError, match=f"texels is {texels}; expected .* at least 1"):
        select_part(blank(6, 9), Selection(texels=texels))


def ring_members(*rings: int) -> Tensor:
    """Numbers of the directions of some rings of UBO2003."""
    start = RINGS.cumsum(0) - RINGS
    return torch.cat([NUMBERS[start[ring] : start[ring] + RINGS[ring]] for ring in rings])


@pytest.mark.parametrize(
    ("text", "rings"),
    [
        ("1", range(6)),
        ("2", [0, 2, 4]),
        ("2.0", [0, 2, 4]),
        (" 3 ", [0, 3]),
        ("5", [0, 5]),
        ("6", [0]),
        ("99", [0]),
        ("0,30,60", [0, 2, 4]),
        ("75, 15", [1, 5]),
        ("45,45.05", [3]),
        ("30,30", [2]),
    ],
)
def test_directions_by_rings(text: str, rings: list[int]) -> None:
    part = select_part(blank(2, 2), Selection(directions=text))
    assert torch.equal(part.part.views, ring_members(*rings))
    assert torch.equal(part.part.lights, ring_members(*rings))
    assert torch.equal(part.view, ring_directions()[ring_members(*rings)])


def test_rings_in_any_order_and_each_side_its_own() -> None:
    order = torch.randperm(81, generator=torch.Generator().manual_seed(0))
    view, light = ring_directions()[order], ring_directions()[ring_members(1, 2, 3)]
    part = select_part(blank(2, 2, view, light), Selection(directions="2"))
    assert torch.equal(order[part.part.views].sort().values, ring_members(0, 2, 4))
    assert torch.equal(part.part.views, part.part.views.sort().values)  # the order stays
    assert torch.equal(part.part.lights, torch.cat((torch.arange(6), torch.arange(18, 36))))


def test_rings_of_ubo2014() -> None:
    polar = (0, 11, 23.5, 30, 37.5, 45, 52.5, 60, 67.5, 75)
    counts = (1, 6, 12, 12, 12, 18, 18, 24, 24, 24)
    angles = [
        (t, 2 * math.pi * i / n) for t, n in zip(polar, counts, strict=True) for i in range(n)
    ]
    theta, phi = torch.tensor(angles, dtype=torch.float64).T
    theta = theta.deg2rad()
    directions = torch.stack((theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), -1)
    btf = blank(2, 2, directions.float(), directions.float())
    assert len(btf.view) == 151
    assert len(select_part(btf, Selection(directions="3")).view) == 1 + 12 + 18 + 24
    assert len(select_part(btf, Selection(directions="23.5,67.5")).light) == 12 + 24


@pytest.mark.parametrize(
    ("text", "views", "lights"),
    [
        ("views=0", [0], range(81)),
        ("lights=4-6,0", range(81), [0, 4, 5, 6]),
        ("views=80,80,1; lights = 0 - 20 ", [1, 80], range(21)),
        ("lights=3-3;views=0-80", range(81), [3]),
    ],
)
def test_directions_by_index(text: str, views: list[int], lights: list[int]) -> None:
    part = select_part(blank(2, 2), Selection(directions=text))
    assert part.part.views.tolist() == list(views)
    assert part.part.lights.tolist() == list(lights)


MALFORMED = (
    "0 -1 1.5 nan inf 1e400 half 0,nan 0,30, , views= views=a views=1,,2 views=3-1 views=0,3-1 "
    "views=-1 views=1--2 views=4- views=1.5 angles=3 views=1;lights views=1; =3 views=1=2 "
    f"views={'9' * 5000}"
).split(" ")


@pytest.mark.parametrize("text", ["", *MALFORMED])
def test_malformed_directions(text: str) -> None:
    with pytest.raises(ConfigError, match="^directions is '.*'; expected a number K") as error:
        select_part(blank(2, 2), Selection(directions=text))
    assert repr(text) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,31", "asks for a polar angle of 31 degrees, which no view has; the measured ones are "),
        ("0,30.2", "0, 15, 30, 45, 60, 75"),
        ("-30,30", "-30 degrees, which no view has"),
        ("views=81", "names number 81 of the views, but blank has 81, counted from 0"),
        ("lights=3;views=0-999999999", "names number 999999999 of the views"),
        ("lights=0-200", "names number 200 of the lights"),
    ],
)
def test_directions_that_were_not_measured(text: str, message: str) -> None:
    with pytest.raises(DataError) as error:
        select_part(blank(2, 2), Selection(directions=text))
    assert message in str(error.value) and repr(text) in str(error.value)


def test_a_light_that_was_not_measured() -> None:
    btf = blank(2, 2, light=ring_directions()[1:7])
    with pytest.raises(DataError, match="0 degrees, which no light has; .* ones are 15"):
        select_part(btf, Selection(directions="0,15"))


def test_composition() -> None:
    selection = Selection(crop=(3, 1, 5, 4), texels=6, directions="views=1,3;lights=0-2")
    at_once = select_part(counted(6, 9), selection, seed=5)
    cropped = select_part(counted(6, 9), Selection(crop=selection.crop))
    thinned = select_part(cropped, Selection(texels=6), seed=5)
    one_by_one = select_part(
        select_part(thinned, Selection(directions="views=1-3")),  # of these, the first and last
        Selection(directions="views=0,2;lights=0-2"),
    )
    assert torch.equal(at_once.texels(), one_by_one.texels())
    assert (at_once.height, at_once.width) == (thinned.height, thinned.width)
    assert set(texel_numbers(at_once).flatten().tolist()) <= set(
        torch.arange(54).view(6, 9)[1:5, 3:8].flatten().tolist()
    )
    green, blue = at_once.texels()[0, :, 1:].T.tolist()
    assert (green, blue) == ([1, 1, 1, 3, 3, 3], [0, 1, 2, 0, 1, 2])
    wi, wo = at_once.pairs()
    assert torch.equal(wi[4], counted(1, 1).light[1]) and torch.equal(wo[4], at_once.view[1])


def test_parts_of_arrays() -> None:
    btf = counted(3, 4)
    part = select_part(btf, Selection(crop=(1, 1, 2, 2), directions="views=2;lights=3,1"))
    expected = btf.texels().view(3, 4, 4, 4, 3)[1:, 1:3, 2][:, :, [1, 3]].reshape(4, 2, 3)
    assert torch.equal(part.texels(), expected)
