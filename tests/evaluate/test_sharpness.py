"""Shares of gradients: their extremes, against blur and noise, and against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from torch import Tensor

from spmm_torch.evaluate.sharpness import GradientSums, gradients

SIZE = 48


@pytest.fixture
def picture() -> Tensor:
    """A random texture, smooth over about two texels."""
    generator = np.random.default_rng(0)
    return torch.from_numpy(gaussian_filter(generator.random((SIZE, SIZE, 3)), (1, 1, 0))).float()


def blurred(picture: Tensor, sigma: float) -> Tensor:
    return torch.from_numpy(gaussian_filter(picture.numpy(), (sigma, sigma, 0)))


def noisy(picture: Tensor, size: float) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return picture + size * torch.randn(picture.shape, generator=generator)


def test_the_original_keeps_all(picture: Tensor) -> None:
    sums = GradientSums.of(picture, picture)
    assert sums.share == sums.share_in_place == 1.0


def test_blur_takes_both_shares_away(picture: Tensor) -> None:
    found = [GradientSums.of(picture, blurred(picture, sigma)) for sigma in (0.5, 1.0, 2.0)]
    for values in ([sums.share for sums in found], [sums.share_in_place for sums in found]):
        assert 1.0 > values[0] > values[1] > values[2] > 0.0


def test_noise_raises_the_energy_and_not_what_is_in_place(picture: Tensor) -> None:
    soft = blurred(picture, 1.0)
    before, after = GradientSums.of(picture, soft), GradientSums.of(picture, noisy(soft, 0.1))
    assert after.share > 2.0 * before.share
    assert after.share_in_place == pytest.approx(before.share_in_place, abs=0.05)


def test_another_texture_is_sharp_and_not_in_place(picture: Tensor) -> None:
    sums = GradientSums.of(picture, picture.flip(0, 1))
    assert sums.share == pytest.approx(1.0)
    assert abs(sums.share_in_place) < 0.1


def test_contrast_counts_squared_as_energy_and_plainly_in_place(picture: Tensor) -> None:
    sums = GradientSums.of(picture, 0.5 * picture + 3.0)
    assert sums.share == pytest.approx(0.25, rel=1e-5)
    assert sums.share_in_place == pytest.approx(0.5, rel=1e-5)


def test_gradients_are_those_of_numpy(picture: Tensor) -> None:
    exact = picture.double().numpy()
    expected = np.concatenate([np.diff(exact, axis=axis).ravel() for axis in (0, 1)])
    np.testing.assert_array_equal(gradients(picture).numpy(), expected)


def test_sums_add_up_over_pictures(picture: Tensor) -> None:
    pairs = ((picture, blurred(picture, 1.0)), (3.0 * picture, noisy(picture, 0.1)))
    total = GradientSums.of(*pairs[0]) + GradientSums.of(*pairs[1])
    side_by_side = [torch.cat([gradients(pair[side]) for pair in pairs]) for side in (0, 1)]
    assert total.original == pytest.approx(float(side_by_side[0] @ side_by_side[0]))
    assert total.product == pytest.approx(float(side_by_side[0] @ side_by_side[1]))


def test_a_flat_original_has_no_shares() -> None:
    for flat in (torch.ones(1, 1, 3), torch.ones(4, 4, 3)):
        sums = GradientSums.of(flat, flat)
        assert sums.share is None
        assert sums.share_in_place is None
