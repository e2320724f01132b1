"""MSSIM: its extremes, its oracle, and what counts."""

from __future__ import annotations

import kornia.metrics
import numpy as np
import pytest
import torch

from spmm_torch.evaluate.mssim import WINDOW, mean_score, mssim, ssim_map, y_cr_cb
from spmm_torch.evaluate.renderings import Renderings

SIZE = 40


def pictures(noise: float, seed: int = 0) -> Renderings:
    """Smooth pictures, the model's with noise; a disk of them counts."""
    generator = torch.Generator().manual_seed(seed)
    axis = torch.linspace(-1.0, 1.0, SIZE)
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    original = 0.5 + 0.3 * torch.stack((x, torch.sin(9.0 * y), x * y), dim=-1)[None]
    model = original + noise * torch.randn(original.shape, generator=generator)
    counts = (x * x + y * y < 0.9)[None]
    return Renderings(("light",), original, model, model, torch.ones(1), counts)


def test_equal_pictures_have_1() -> None:
    assert mssim(pictures(0.0)) == [{"y": 1.0, "cr": 1.0, "cb": 1.0, "mean": 1.0}]


def test_it_falls_with_noise() -> None:
    scores = [mssim(pictures(noise))[0] for noise in (0.0, 0.01, 0.05, 0.2)]
    for key in ("y", "cr", "cb", "mean"):
        values = [score[key] for score in scores]
        assert values == sorted(values, reverse=True)
        assert len(set(values)) == 4
    assert scores[-1]["mean"] == pytest.approx(np.mean([scores[-1][k] for k in ("y", "cr", "cb")]))


def test_the_map_is_that_of_kornia() -> None:
    first, second = torch.rand(2, 1, 1, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    expected = kornia.metrics.ssim(first, second, WINDOW, max_val=1.0, padding="valid")[0, 0]
    found = ssim_map(first[0, 0].double().numpy(), second[0, 0].double().numpy())
    edge = WINDOW // 2
    np.testing.assert_allclose(found[edge:-edge, edge:-edge], expected.numpy(), atol=1e-5)


def test_colours_are_those_of_bt601() -> None:
    shown = torch.tensor([[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    y, cr, cb = y_cr_cb(shown)
    np.testing.assert_allclose(y[0], [0.0, 1.0, 0.299, 0.114], atol=1e-6)
    np.testing.assert_allclose(cr[0], [0.5, 0.5, 1.0, 0.5 - 0.114 / 1.402], atol=1e-5)
    np.testing.assert_allclose(cb[0], [0.5, 0.5, 0.5 - 0.299 / 1.772, 1.0], atol=1e-5)


def test_pixels_that_do_not_count_change_nothing() -> None:
    clean, noisy = pictures(0.05), pictures(0.05)
    noisy.model[~noisy.counts] = 0.9
    assert mssim(noisy) == mssim(clean)
    noisy.model[0, SIZE // 2, SIZE // 2] = 0.9
    assert mssim(noisy)[0]["y"] < mssim(clean)[0]["y"]


def test_the_mean_is_over_pictures() -> None:
    scores = [dict.fromkeys(("y", "cr", "cb", "mean"), value) for value in (0.5, 0.7)]
    assert mean_score(scores) == pytest.approx(dict.fromkeys(("y", "cr", "cb", "mean"), 0.6))
