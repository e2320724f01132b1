"""Names tell directions, and the reader understands them."""

from __future__ import annotations

import math
import re

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.data.file_names import parse_angles
from spmm_torch.data.picture_grid import unit_vectors
from spmm_torch.data.writers.names import picture_names
from spmm_torch.errors import OutputError
from spmm_torch.geometry.directions import UBO2014_RINGS, direction_from_angles, ring_directions

BONN = re.compile(
    r"tv(\d{3})_pv(\d{3})/(\d{5}) tl(\d{3}) pl(\d{3}) tv(?P<tv>\d{3}) pv(?P<pv>\d{3})\.jpg"
)


def test_names_of_ubo2003() -> None:
    directions = ring_directions()
    names = picture_names(directions, directions, ".jpg")
    # The pair of this number is the known one of the data set.
    assert names[8][0] == "tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg"
    assert names[80][80] == "tv075_pv345/06560 tl075 pl345 tv075 pv345.jpg"
    flat = [name for row in names for name in row]
    assert len(set(flat)) == 6561
    assert len({name.split("/")[1][:5] for name in flat}) == 6561
    for name in flat:
        match = BONN.fullmatch(name)
        assert match and match[1] == match["tv"] and match[2] == match["pv"]


def test_half_degrees() -> None:
    directions = ring_directions(UBO2014_RINGS)
    names = picture_names(directions, directions[:1], ".exr")
    assert names[7][0] == "tv023.5_pv000/00007 tl000 pl000 tv023.5 pv000.exr"
    assert {re.search(r" tv([\d.]+) ", row[0])[1] for row in names} == {
        f"{polar:05.1f}".removesuffix(".0").zfill(3) for polar, _ in UBO2014_RINGS
    }


ANGLES = st.lists(st.tuples(st.floats(0.0, 90.0), st.floats(-180.0, 720.0)), min_size=1, max_size=6)


@given(ANGLES)
def test_directions_read_back(angles: list[tuple[float, float]]) -> None:
    theta, phi = torch.tensor(angles, dtype=torch.float64).deg2rad().unbind(-1)
    directions = direction_from_angles(theta, phi).float()
    try:
        names = picture_names(directions, directions[:1], ".png")
    except OutputError:
        distance = torch.cdist(directions, directions) + 9.0 * torch.eye(len(directions))
        assert distance.min() < math.radians(0.01)
        return
    pairs = [parse_angles(row[0]) for row in names]
    views = unit_vectors([view for view, _ in pairs])
    assert (views - directions).norm(dim=-1).max() < math.radians(0.001)
    assert len({view for view, _ in pairs}) == len(directions)
    assert all(0.0 <= view[0] <= 90.0 and 0.0 <= view[1] < 360.0 for view, _ in pairs)


def test_directions_that_fall_together() -> None:
    theta = torch.tensor([0.5, 0.5 + 1e-6], dtype=torch.float64)
    close = direction_from_angles(theta, torch.zeros(2, dtype=torch.float64))
    for arguments in ((close, close[:1]), (close[:1], close)):
        with pytest.raises(OutputError, match="0 and 1 are both .theta 028.648, phi 000"):
            picture_names(*arguments, ".png")
