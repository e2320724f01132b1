"""Pictures: orientation, exposure, colours."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from spmm_torch.report.pictures import (
    cluster_colours,
    css_colour,
    difference_gain,
    display,
    exposure,
    heat_colours,
    png_uri,
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


def test_display_is_gamma_encoded_and_clipped() -> None:
    linear = np.array([[[-0.1, 0.0, 0.25], [0.5, 0.75, 9.0]]], np.float32)
    codes = display(linear, 2.0)
    expected = [0, 0, round(255 * 0.5 ** (1 / 2.2)), 255, 255, 255]
    assert codes.dtype == np.uint8
    assert codes.ravel().tolist() == expected


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_exposure_maps_the_99th_percentile_to_one(scale: float) -> None:
    picture = np.random.default_rng(0).gamma(1.0, scale, (32, 32, 3)).astype(np.float32)
    shown = picture * exposure(picture)
    assert np.mean(shown > 1.0) == pytest.approx(0.01, abs=0.001)


def test_exposure_of_nearly_and_fully_black() -> None:
    picture = np.zeros((16, 16, 3), np.float32)
    assert exposure(picture) == 1.0
    picture[3, 4, 1] = 0.5
    assert exposure(picture) == 2.0


@pytest.mark.parametrize(
    ("worst", "gain"), [(0.0, 64), (0.1, 8), (0.125, 8), (0.5, 2), (0.9, 1), (3.0, 1)]
)
def test_difference_gain(worst: float, gain: int) -> None:
    assert difference_gain(worst) == gain


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
