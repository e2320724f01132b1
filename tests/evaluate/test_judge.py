"""Figures that a fit reported, beside those of its saved model."""

from __future__ import annotations

import pytest

from spmm_torch.evaluate.judge import report_difference


def figures(snr: float) -> dict[str, dict[str, float]]:
    return {"snr_db": {"with_residual": snr}, "psnr_db": {}}


@pytest.mark.parametrize(("found", "reported"), [(112.0, 108.0), (90.0, 90.3), (62.0, 62.01)])
def test_rounding_of_near_perfect_fits_is_no_difference(found: float, reported: float) -> None:
    assert report_difference(figures(found), figures(reported)) == 0.0


@pytest.mark.parametrize(("found", "reported"), [(90.0, 85.0), (48.0, 48.02), (12.0, 12.02)])
def test_another_model_is_one(found: float, reported: float) -> None:
    difference = report_difference(figures(found), figures(reported))
    assert difference == pytest.approx(abs(found - reported))
