"""Changes of hue and saturation: exact, and their linear approximations."""

from __future__ import annotations

import colorsys
import math

import pytest
import torch

from spmm_torch.edit.colour import (
    MAX_SATURATION,
    change_colours,
    change_table,
    linear_change,
    linear_changes,
    unit_colours,
)

COLOURS = torch.rand(200, 3, generator=torch.Generator().manual_seed(1))


def by_colorsys(rgb: list[float], hue: float, saturation: float) -> tuple[float, ...]:
    """The change by the standard library."""
    h, s, v = colorsys.rgb_to_hsv(*rgb)
    return colorsys.hsv_to_rgb((h + hue / (2.0 * math.pi)) % 1.0, min(1.0, s * saturation), v)


@pytest.mark.parametrize(("hue", "saturation"), [(2.0, 1.0), (-1.9, 0.4), (0.0, 1.7), (5.0, 0.0)])
def test_exact_change_is_that_of_the_standard_library(hue: float, saturation: float) -> None:
    expected = torch.tensor([by_colorsys(rgb, hue, saturation) for rgb in COLOURS.tolist()])
    torch.testing.assert_close(
        change_colours(COLOURS, hue, saturation), expected, rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_exact_change_keeps_scale(scale: float) -> None:
    """e(s c) = s e(c): dark colours keep their saturation, bright ones are not clipped."""
    torch.testing.assert_close(
        change_colours(scale * COLOURS, 1.0, 1.2) / scale, change_colours(COLOURS, 1.0, 1.2)
    )
    assert torch.equal(change_colours(-COLOURS, 1.0, 1.2), torch.zeros_like(COLOURS))


@pytest.mark.parametrize(("hue", "saturation"), [(0.7, 1.3), (-2.0, 0.5)])
def test_closed_form_is_least_squares(hue: float, saturation: float) -> None:
    """[WDR11 Eq. 6] solved by a library."""
    colours = unit_colours(500)
    exact = change_colours(colours, hue, saturation)
    expected = torch.linalg.lstsq(colours, exact).solution.T
    found = linear_changes(colours, torch.tensor([0.0, hue]), torch.tensor([saturation, 1.0]))
    torch.testing.assert_close(found[1, 0], expected, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(found[0, 1], torch.eye(3, dtype=torch.float64))


def test_unit_colours_fill_the_positive_octant() -> None:
    colours = unit_colours()
    assert colours.shape == (10_000, 3)
    torch.testing.assert_close(colours.norm(dim=1), torch.ones(10_000, dtype=torch.float64))
    assert float(colours.min()) >= 0.0
    # The mean of a uniform direction of the octant is 1/2 along each axis.
    torch.testing.assert_close(colours.mean(0), torch.full((3,), 0.5).double(), atol=0.01, rtol=0)


def test_table_has_10000_changes_in_352_kb() -> None:
    table = change_table()
    assert table.shape == (100, 100, 3, 3)
    assert round(table.numel() * table.element_size() / 1024) == 352
    assert table is change_table()  # made once
    exact = linear_changes(
        unit_colours(), torch.tensor([2.0 * math.pi * 37 / 100]), torch.tensor([MAX_SATURATION])
    )
    torch.testing.assert_close(table[37, 99].double(), exact[0, 0], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("hue", "saturation"), [(1.234, 0.777), (-0.02, 1.99), (6.28, 0.01)])
def test_between_the_changes_of_the_table(hue: float, saturation: float) -> None:
    exact = linear_changes(unit_colours(), torch.tensor([hue]), torch.tensor([saturation]))[0, 0]
    torch.testing.assert_close(linear_change(hue, saturation).double(), exact, rtol=0.0, atol=2e-3)
