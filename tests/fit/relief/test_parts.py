"""The parts of the search, against SciPy and by their properties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import map_coordinates, median_filter

from spmm_torch.fit.relief.border import border_rule
from spmm_torch.fit.relief.drift import find_drift, without_plane
from spmm_torch.fit.relief.pictures import (
    PictureStack,
    chosen_lights,
    chosen_views,
    logarithms,
    normalized,
    read_stack,
    spread,
)
from spmm_torch.fit.relief.resample import resampled, resized
from spmm_torch.fit.relief.smooth import lowest, median, smoothed_cost
from spmm_torch.fit.relief.sweep import sweep_heights
from spmm_torch.geometry.directions import ring_directions
from tests.planted.reliefs import planted_relief, smooth_noise


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize(("repeats", "mode"), [(True, "grid-wrap"), (False, "nearest")])
def test_pictures_are_read_as_by_scipy(repeats: bool, mode: str) -> None:
    pictures = noise(2, 7, 9)
    column, row = 14.0 * noise(1, 5, 6, seed=1), 9.0 * noise(1, 5, 6, seed=2)
    found = resampled(pictures[None], column[None], row[None], repeats)[0, 0]
    place = np.stack((row[0].numpy(), column[0].numpy()))
    for picture, values in zip(pictures, found, strict=True):
        expected = map_coordinates(picture.numpy(), place, order=1, mode=mode)
        np.testing.assert_allclose(values.numpy(), expected, atol=2e-5)


def test_a_picture_of_its_own_size_stays() -> None:
    picture = noise(6, 5)
    torch.testing.assert_close(resized(picture, 6, 5, True), picture)
    assert resized(picture, 12, 10, False).shape == (12, 10)


def test_the_median_is_scipys() -> None:
    picture = noise(7, 8)
    expected = median_filter(picture.numpy(), 3, mode="grid-wrap")
    np.testing.assert_array_equal(median(picture, True).numpy(), expected)


def test_the_lowest_of_a_parabola_is_exact_inside_and_whole_at_the_ends() -> None:
    candidates = torch.arange(9.0)[:, None]
    truth = torch.tensor([3.3, 5.0, 6.49, -2.0, 12.0])
    found = lowest((candidates - truth).square())
    torch.testing.assert_close(found, torch.tensor([3.3, 5.0, 6.49, 0.0, 8.0]))


def test_texels_that_cannot_tell_follow_their_neighbours() -> None:
    cost = torch.full((9, 12, 12), 0.5)
    cost[6, :3] = 0.0  # rows 0 to 2 know
    for repeats in (True, False):
        assert torch.equal(smoothed_cost(cost, repeats).argmin(0), torch.full((12, 12), 6))


def test_pictures_that_agree_have_no_disagreement_and_strangers_have_one() -> None:
    picture = normalized(noise(1, 1, 16, 16))
    zero = torch.zeros(6, 2)
    same = PictureStack(picture.expand(6, 2, 16, 16), torch.ones(6, 2), zero, zero, True)
    assert float(same.disagreement(torch.zeros(1, 16, 16)).max()) < 1e-5
    strangers = replace(same, values=normalized(noise(6, 2, 16, 16)))
    mean = float(strangers.disagreement(torch.zeros(1, 16, 16)).mean())
    assert mean == pytest.approx(1.0, abs=0.05)


def test_what_half_of_the_views_do_not_show_is_unknown() -> None:
    stack = read_stack(planted_relief().btf, torch.arange(20), torch.arange(2))
    far = torch.full((1, 48, 48), 3.0)  # beyond the pictures of all views but the one from above
    assert torch.equal(stack.disagreement(far), torch.ones(1, 48, 48))


def test_values_below_zero_and_black_pictures_stay_finite() -> None:
    values = logarithms(torch.stack((noise(8, 8), torch.zeros(8, 8))))
    assert bool(torch.isfinite(values).all())
    assert float(normalized(values)[1].abs().max()) == 0.0


def test_chosen_lights_are_high_and_apart() -> None:
    btf = planted_relief(lights=ring_directions(), views=ring_directions(((0.0, 1), (20.0, 5)))).btf
    lights = chosen_lights(btf, 7)
    assert len(set(lights.tolist())) == 7
    chosen = btf.light[lights]
    assert float(chosen[:, 2].min()) > 0.4
    assert float((chosen @ chosen.T).fill_diagonal_(-1.0).max()) < 0.9
    assert len(chosen_views(btf)) == 6
    assert spread(ring_directions(), 3, 0).tolist()[0] == 0


def test_drift_has_neither_mean_nor_plane() -> None:
    shift, slope = noise(30, 2), noise(30, 2, seed=1)
    rest, plane = without_plane(shift + 5.0 - 0.7 * slope, slope)
    before, base = without_plane(shift, slope)
    torch.testing.assert_close(rest, before, atol=1e-5, rtol=0.0)
    assert plane - base == pytest.approx(0.7, abs=1e-5)
    assert float(rest.mean(0).abs().max()) < 1e-5
    assert abs(float((rest * (slope - slope.mean(0))).sum())) < 1e-3


def test_views_without_drift_show_only_noise() -> None:
    planted = planted_relief(noise=0.05)
    stack = read_stack(planted.btf, torch.arange(len(planted.btf.view)), torch.arange(5))
    found = find_drift(replace(stack, repeats=True), planted.height)
    assert found.is_noise(found.shift)
    assert found.plane == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize("columns", [40, 39])
def test_a_border_is_a_seam_where_the_texture_does_not_repeat(columns: int) -> None:
    texture = smooth_noise((40, 40), 3.0, torch.Generator().manual_seed(0))
    part = smooth_noise((80, 80), 3.0, torch.Generator().manual_seed(1))[:40, :columns]
    zero = torch.zeros(1, 2)
    for picture, rule in ((texture, "repeat"), (part, "mirror"), (noise(30, 30), "repeat")):
        stack = PictureStack(normalized(picture)[None, None], torch.ones(1, 1), zero, zero)
        assert border_rule(stack) == rule


def test_large_pictures_are_swept_from_coarse_to_fine() -> None:
    views = ring_directions(((0.0, 1), (35.0, 5), (55.0, 7)))
    lights = ring_directions(((30.0, 3),))
    planted = planted_relief(size=(64, 120), views=views, lights=lights, depth=0.01)
    stack = read_stack(planted.btf, torch.arange(len(views)), torch.arange(3))
    height = sweep_heights(replace(stack, repeats=True), 0.03)
    both = torch.stack((height.flatten(), planted.height.flatten()))
    assert float(torch.corrcoef(both)[0, 1]) > 0.95
