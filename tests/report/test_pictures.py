"""Pictures: orientation, exposure, colours."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.report.pictures import (
    cluster_colours,
    css_colour,
    difference_gain,
    heat_colours,
    png_uri,
    shared_gain,
)


def decode(uri: str) -> np.ndarray:
    """Codes of a PNG data URI."""
    head, _, data = uri.partition(",")
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data, validate=True))))


def test_a_png_keeps_codes_and_orientation() -> None:
    codes = np.zeros((4, 6, 3), np.uint8)
    codes[0, :, 0] = 255  # top row red
    codes[:, 5, 1] = 200  # right column green
    for given in (codes, np.ascontiguousarray(codes[::-1])[::-1]):
        assert np.array_equal(decode(png_uri(given)), codes)


@pytest.mark.parametrize(
    ("worst", "gain"), [(0.0, 64), (0.1, 8), (0.125, 8), (0.5, 2), (0.9, 1), (3.0, 1)]
)
def test_difference_gain(worst: float, gain: int) -> None:
    assert difference_gain(worst) == gain


def test_the_shared_gain_is_that_of_the_largest_difference() -> None:
    small, large = torch.full((8, 8, 3), -0.01), torch.full((8, 8, 3), 0.2)
    large[0, 0, 0] = 9.0  # one value may clip
    assert shared_gain([small, large]) == 4
    assert shared_gain([small]) == 64


def test_cluster_colours_are_stable_and_distinct() -> None:
    many = cluster_colours(256)
    assert many.shape == (256, 3)
    assert np.array_equal(cluster_colours(32), many[:32])
    assert len(np.unique(many[:64], axis=0)) == 64
    assert cluster_colours(0).shape == (0, 3)


@pytest.mark.parametrize("steps", [1, 2, 7, 300])
def test_heat_colours_get_lighter(steps: int) -> None:
    colours = heat_colours(steps)
    assert colours.shape == (steps, 3)
    luma = colours @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luma) >= -1.0).all()


def test_css_colour() -> None:
    assert css_colour(np.array([48, 98, 171], np.uint8)) == "#3062ab"
