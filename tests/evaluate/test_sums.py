"""Squared errors against brute force, whatever the blocks."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.evaluate.angles import by_angle, rings
from spmm_torch.evaluate.sums import squared_errors
from spmm_torch.geometry.directions import (
    RULES,
    direction_pairs,
    hemisphere_spiral,
    ring_directions,
)
from spmm_torch.model.relief import Relief
from tests.planted.btfs import COARSE_RINGS, rough_btf
from tests.planted.models import planted_model, planted_relief, with_components, with_relief

SIZE = 5


def models() -> dict[str, SPMM]:
    """With a residual of clusters, of rank R, and of both."""
    clusters = planted_model(SIZE, rings=COARSE_RINGS, residual=0.05, seed=1)
    rank, both = (with_components(clusters, beside=beside) for beside in (False, True))
    return {"clusters": clusters, "components": rank, "both": both}


def drifting_relief(rule: str, views: int) -> Relief:
    """A relief that is deep enough to show other texels, under pictures that drift."""
    drift = 0.1 * torch.rand(views, 2, generator=torch.Generator().manual_seed(2)) - 0.05
    return planted_relief(SIZE, SIZE, 0.2, rule, drift)


@pytest.mark.parametrize("kind", ["clusters", "components", "both"])
@pytest.mark.parametrize("rule", [None, *RULES])
@pytest.mark.parametrize("block", [1 << 23, 3 * 400 * 2, 100])
def test_sums_are_those_of_pictures(block: int, rule: str | None, kind: str) -> None:
    model, btf = models()[kind], rough_btf(SIZE)
    if rule is not None:
        model = with_relief(model, drifting_relief(rule, len(model.view)))
    fitted = torch.rand(btf.pair_count, generator=torch.Generator().manual_seed(0)) < 0.7
    told: list[int] = []
    found = squared_errors(model, btf, fitted, told.append, block)
    assert sum(told) == SIZE * SIZE
    value = btf.texels().double()  # [T, D, C]
    errors = [whole_table(model, residual).double() - value for residual in (False, True)]
    totals = (found.energy, found.without_residual, found.with_residual)
    for expected, total in zip((value, *errors), totals, strict=True):
        torch.testing.assert_close(total, expected.square().sum((0, 2)), rtol=1e-4, atol=1e-8)
    mean = torch.stack([value[model.labels == k].mean(0) for k in range(model.cluster_count)])
    expected = (value - mean[model.labels]).square().sum((0, 2))
    torch.testing.assert_close(found.cluster_mean, expected, rtol=1e-5, atol=1e-9)
    expected = errors[1].square().sum(2)[:, fitted].sum(1)
    torch.testing.assert_close(found.texel_error, expected, rtol=1e-4, atol=1e-8)


@torch.no_grad()
def whole_table(model: SPMM, residual: bool) -> Tensor:
    """Every texel at every measured pair `[T, D, C]`, as anybody would ask for it."""
    texel = torch.arange(model.texel_count)
    u, v = (texel % SIZE + 0.5) / SIZE, 1.0 - (texel // SIZE + 0.5) / SIZE
    wi, wo = direction_pairs(model.light, model.view)
    uv = torch.stack((u, v), -1)[:, None]
    if model.relief is not None and model.relief.drift is not None:
        uv = uv + model.relief.drift.repeat_interleave(len(model.light), 0)
    return model(uv, wi[None], wo[None], residual=residual)


def test_views_that_were_not_fitted_do_not_drift() -> None:
    model, btf = planted_model(SIZE, rings=COARSE_RINGS, seed=1), rough_btf(SIZE)
    fitted = torch.ones(btf.pair_count, dtype=torch.bool)
    relief = drifting_relief("repeat", len(model.view))
    fewer = with_relief(model, planted_relief(SIZE, SIZE, 0.2))
    moved = with_relief(model, relief)
    moved.view[5] = torch.nn.functional.normalize(moved.view[5] + 0.01, dim=0)
    found = squared_errors(moved, btf, fitted).with_residual.view(len(btf.view), -1)
    still = squared_errors(fewer, btf, fitted).with_residual.view(len(btf.view), -1)
    torch.testing.assert_close(found[5], still[5], rtol=1e-2, atol=1e-6)
    assert not torch.allclose(found[6], still[6], rtol=1e-2)


def test_the_angle_table_adds_up() -> None:
    directions = ring_directions(COARSE_RINGS)
    pairs = len(directions) ** 2
    energy, error = torch.rand(2, pairs, dtype=torch.float64)
    table = by_angle(directions, directions, energy, error)
    assert table.view == table.light == (0.0, 20.0, 40.0, 60.0)
    assert float(table.energy.sum()) == pytest.approx(float(energy.sum()))
    assert float(table.error.sum()) == pytest.approx(float(error.sum()))
    own = error.view(len(directions), -1)[1:6, -8:]  # views at 20 degrees, lights at 60
    assert float(table.error[1, 3]) == pytest.approx(float(own.sum()))


def test_directions_without_rings_go_into_bands() -> None:
    directions = hemisphere_spiral(200)
    band, degrees = rings(directions)
    assert len(degrees) == 12
    polar = torch.rad2deg(torch.arccos(directions[:, 2]))
    assert float((polar - torch.tensor(degrees)[band]).abs().max()) <= 3.76
