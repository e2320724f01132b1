"""The test vectors of docs/conventions.md are what the package computes."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MAX_PARAMETERS, MODEL_NAMES
from spmm_torch.geometry import directions
from spmm_torch.lobes.batch import LobeBatch
from tests.docs.markdown import table
from tests.locations import DOCS

PAGE = DOCS / "conventions.md"
# Half a unit of the last printed digit, and the rounding of float32.
TOLERANCE = 2e-7


def numbers(cell: str) -> Tensor:
    """The numbers of one cell, float64."""
    return torch.tensor([float(word) for word in cell.split(",")], dtype=torch.float64)


def radians(*cells: str) -> list[Tensor]:
    """Angles in radians of cells in degrees."""
    return [torch.tensor(math.radians(float(cell)), dtype=torch.float64) for cell in cells]


def direction(theta: str, phi: str) -> Tensor:
    """The unit vector `[3]` of two cells."""
    return directions.direction_from_angles(*radians(theta, phi))


def assert_near(found: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(found.double(), expected, rtol=0.0, atol=TOLERANCE)


@pytest.mark.parametrize("row", table(PAGE, "theta", "phi", "x", "y", "z"), ids=str)
def test_directions(row: list[str]) -> None:
    assert_near(direction(*row[:2]), numbers(", ".join(row[2:])))


@pytest.mark.parametrize("row", table(PAGE, "rings", "directions", "spacing in degrees"), ids=str)
def test_rings(row: list[str]) -> None:
    found = directions.ring_directions(getattr(directions, row[0]))
    assert len(found) == int(row[1])
    spacing = math.degrees(directions.angular_spacing(found))
    assert spacing == pytest.approx(float(row[2]), abs=5e-4)


@pytest.mark.parametrize("row", table(PAGE, "u", "v", "texels", "weights"), ids=str)
def test_texels(row: list[str]) -> None:
    uv = numbers(", ".join(row[:2]))
    index, weight = directions.texel_at(uv, height=2, width=4)
    met = weight > 0.0
    assert index[met].tolist() == [int(word) for word in row[2].split(",")]
    assert_near(weight[met], numbers(row[3]))


@pytest.mark.parametrize("row", table(PAGE, "d", "view", "light"), ids=str)
def test_pairs(row: list[str]) -> None:
    light, view = torch.eye(3), torch.eye(3)[:2]
    wi, wo = directions.direction_pairs(light, view)
    d, of_view, of_light = (int(cell) for cell in row)
    assert torch.equal(wi[d], light[of_light])
    assert torch.equal(wo[d], view[of_view])


@pytest.mark.parametrize(
    "row",
    table(PAGE, "theta of the normal", "phi of the normal", "theta of wi", "phi of wi", "rho"),
    ids=str,
)
def test_cosine_of_the_lobe(row: list[str]) -> None:
    normal, wi = direction(*row[:2])[None], direction(*row[2:4])[None]
    wo = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    model = torch.tensor([MODEL_NAMES.index("lambertian")])
    lobe = LobeBatch(model, normal.new_zeros(1, MAX_PARAMETERS), normal, normal.new_zeros(1))
    assert_near(lobe.eval(wi, wo), numbers(row[4]))


@pytest.mark.parametrize(
    "row", table(PAGE, "theta", "phi", "angle", "tangent", "bitangent", "normal"), ids=str
)
def test_frames(row: list[str]) -> None:
    frame = directions.frame_from_normal(direction(*row[:2]), *radians(row[2]))
    assert_near(frame, torch.stack([numbers(cell) for cell in row[3:]]))


@pytest.mark.parametrize("row", table(PAGE, "theta", "phi", "disk x", "disk y"), ids=str)
def test_disk(row: list[str]) -> None:
    assert_near(directions.disk_from_normal(direction(*row[:2])), numbers(", ".join(row[2:])))
