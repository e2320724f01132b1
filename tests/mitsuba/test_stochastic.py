"""One texel drawn by its bilinear weight: what it shows, how often, and that rays agree."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch.geometry.directions import MIRROR, REPEAT, ring_directions, texel_at
from spmm_torch.mitsuba.arrays import drawn
from spmm_torch.mitsuba.texels import texel_drawn
from tests.mitsuba.queries import interaction, random_queries, values, vectors
from tests.planted.models import FEW_RINGS, uneven_model, with_components
from tests.planted.runs import model_folder

RINGS = ring_directions(FEW_RINGS)


def test_values_and_densities_at_texel_centres_are_those_of_torch(mi: Any, tmp_path: Path) -> None:
    model = with_components(uneven_model([0, 3, 2, 4, 1, 3, 2, 1], 2, RINGS, RINGS), beside=True)
    run = model_folder(tmp_path / "run", model)
    plugin = {"type": "spmm", "filename": str(run), "filter_type": "stochastic"}
    bsdf, (_, wi, wo) = mi.load_dict(plugin), random_queries(2000)
    texel = torch.arange(2000) % model.texel_count
    row, column = texel // model.width, texel % model.width
    uv = torch.stack((column + 0.5, model.height - row - 0.5), dim=1)
    uv = uv / torch.tensor([model.width, model.height])  # powers of two: centres are exact
    found = bsdf.eval_pdf(mi.BSDFContext(), interaction(mi, uv, wo), vectors(mi, wi))
    with torch.no_grad():
        rgb, density = model(uv, wi, wo), model.pdf(uv, wi, wo)
    torch.testing.assert_close(values(found[0]), rgb, rtol=2e-5, atol=2e-6)
    torch.testing.assert_close(values(found[1]), density, rtol=1e-4, atol=2e-6)


@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_a_texel_is_drawn_as_often_as_it_weighs(rule: str, mi: Any) -> None:
    count, (rows, columns) = 1 << 16, (3, 5)
    noise = np.random.default_rng(0).random((4, count)).astype(np.float32)
    for u, v in ((0.37, 0.81), (0.02, 0.99), (1.45, -0.3)):
        # Places so near to each other that only their bits differ.
        uv = mi.Point2f(mi.Float(u + 1e-5 * noise[0]), mi.Float(v + 1e-5 * noise[1]))
        numbers = drawn(uv.x, uv.y, mi.Float(noise[2]), mi.Float(noise[3]))
        texel = np.array(texel_drawn(uv, rows, columns, rule, numbers))
        share = np.bincount(texel, minlength=rows * columns) / count
        at, weight = texel_at(torch.tensor([[u, v]]), rows, columns, rule)
        expected = np.bincount(at[0].numpy(), weight[0].numpy(), rows * columns)
        # Five standard deviations of a share.
        np.testing.assert_allclose(share, expected, atol=2.5 / np.sqrt(count) + 1e-4)


def test_one_ray_draws_as_a_wavefront_does(mi: Any) -> None:
    numbers = np.random.default_rng(1).random((4, 50)).astype(np.float32)
    together = np.array([np.array(part) for part in drawn(*(mi.Float(row) for row in numbers))])
    variant = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        alone = np.array([drawn(*map(float, column)) for column in numbers.T])
    finally:
        mi.set_variant(variant)
    np.testing.assert_array_equal(alone.T.astype(np.float32), together)
    assert len(np.unique(together)) == 100
