"""Measured BRDFs: lobes are about as right between the measured directions as on them."""

from __future__ import annotations

import pytest

from tests.hard.brdfs import FACTOR, figure, fitted
from tests.locations import needs_data


@pytest.mark.slow
@needs_data("measured_brdfs.npz")
@pytest.mark.parametrize(
    "name", ["merl/white-paint", "merl/alum-bronze", "merl/blue-metallic-paint"]
)
def test_error_between_samples(name: str) -> None:
    """The first two were off by 15.7 and 2.3 times while lobes could be half as wide."""
    found = figure(*fitted(name))
    assert found.on_samples >= 19.0  # 19.7 dB of alum-bronze, whose errors are balanced
    assert found.ratio <= FACTOR


@pytest.mark.slow
@needs_data("measured_brdfs.npz")
def test_peaks_of_all_views_count() -> None:
    """By plain squared errors, ruled by the peaks at 75 degrees, it had 18.3 dB between."""
    btf, result = fitted("merl/purple-paint")
    assert result.report["objective"]["error"] == "by-view"
    assert figure(btf, result).between >= 25.0
