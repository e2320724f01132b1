"""Decibels and sums of squares."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spmm_torch.metrics import Totals, psnr_db, snr_db


def test_against_the_definitions() -> None:
    generator = np.random.default_rng(0)
    y, e = generator.random(500), 0.1 * generator.normal(size=500)
    energy, error = float((y**2).sum()), float((e**2).sum())
    assert snr_db(energy, error) == pytest.approx(10 * np.log10((y**2).sum() / (e**2).sum()))
    expected = 10 * np.log10(2.5**2 / np.mean(e**2))
    assert psnr_db(2.5, error, len(e)) == pytest.approx(expected)


def test_perfect_fits_and_rounding_below_zero() -> None:
    for error in (0.0, -1e-9):
        assert snr_db(1.0, error) == psnr_db(1.0, error, 3) == math.inf


def test_errors_of_what_is_black() -> None:
    """As of a material without light in a folder of measured ones, or an export of one."""
    for dark in (0.0, 5e-324):
        assert snr_db(dark, 1e9) == psnr_db(dark, 1e9, 1) == -math.inf
    assert snr_db(0.0, 0.0) == math.inf
    assert math.isnan(snr_db(1.0, math.nan))  # what is not known stays so


def test_sum() -> None:
    parts = [Totals(1.0, 2.0, 3.0, 4.0), Totals(1e-17, 0.5, 0.25, 0.125)]
    assert Totals.sum(iter(parts)) == Totals(1.0, 2.5, 3.25, 4.125)
    assert Totals.sum(parts[:1]) == parts[0]
    many = [Totals(0.1, 0.1, 0.1, 0.1)] * 10
    assert Totals.sum(many) == Totals(1.0, 1.0, 1.0, 1.0)  # exact, whatever the order
