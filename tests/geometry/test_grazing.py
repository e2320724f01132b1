"""The fade below the lowest measured light."""

from __future__ import annotations

import math

import torch

from spmm_torch.geometry.directions import ring_directions
from spmm_torch.geometry.grazing import LOWEST_COSINE, grazing_fade, lowest_cosine


def test_measured_lights_do_not_fade() -> None:
    light = ring_directions()
    assert torch.equal(grazing_fade(light[:, 2], lowest_cosine(light)), torch.ones(len(light)))


def test_fade_is_the_cosine_over_the_lowest() -> None:
    light = ring_directions(((0.0, 1), (60.0, 4)))
    theta = torch.deg2rad(torch.tensor([50.0, 80.0, 90.0, 120.0], dtype=torch.float64))
    found = grazing_fade(torch.cos(theta), lowest_cosine(light))
    expected = torch.tensor([1.0, 2.0 * math.cos(math.radians(80.0)), 0.0, 0.0]).double()
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-12)


def test_lights_on_the_horizon() -> None:
    assert lowest_cosine(torch.tensor([[1.0, 0.0, 0.0]])) == LOWEST_COSINE
