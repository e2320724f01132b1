"""PSNR of display values."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio

from spmm_torch.evaluate.display import display_psnr

CODES = np.random.default_rng(0).integers(0, 256, (9, 7, 3)).astype(np.uint8)
OTHER = np.random.default_rng(1).integers(0, 256, (9, 7, 3)).astype(np.uint8)


def test_it_is_that_of_scikit_image() -> None:
    expected = peak_signal_noise_ratio(CODES, OTHER, data_range=255)
    assert display_psnr(CODES, OTHER) == pytest.approx(expected)


def test_equal_pictures_are_as_near_as_rounding() -> None:
    assert display_psnr(CODES, CODES) == pytest.approx(10.0 * math.log10(12.0 * 255.0**2))
    nearly = CODES.copy()
    nearly[0, 0, 0] ^= 1
    assert display_psnr(CODES, nearly) == display_psnr(CODES, CODES)


def test_pixels_that_do_not_count_change_nothing() -> None:
    counts = torch.zeros(9, 7, dtype=torch.bool)
    counts[2:5] = True
    mixed = np.where(counts.numpy()[..., None], OTHER, CODES)
    expected = peak_signal_noise_ratio(CODES[2:5], OTHER[2:5], data_range=255)
    assert display_psnr(CODES, OTHER, counts) == pytest.approx(expected)
    assert display_psnr(CODES, mixed, counts) == pytest.approx(expected)
