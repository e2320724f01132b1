"""Samplers of every BRDF of the registry in its local frame, all over its box of parameters."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import BRDF
from spmm_torch.brdf.visible import reflect_about_visible, unit_half_vector, visible_pdf
from spmm_torch.geometry.warp import square_to_beckmann, square_to_beckmann_pdf
from tests.brdf.brdf_cases import (
    ALL_MODELS,
    DTYPES,
    corners,
    direction,
    parameter_grid,
    upper_directions,
)
from tests.chi2 import Grid

DOWN = torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)


def view(degrees: float, dtype: torch.dtype = torch.float64) -> Tensor:
    cosine = torch.tensor(math.cos(math.radians(degrees)), dtype=torch.float64)
    return direction(cosine, torch.tensor(0.3, dtype=torch.float64)).to(dtype)


@pytest.mark.parametrize("polar", [0.0, 50.0, 85.0])
@pytest.mark.parametrize("model", ALL_MODELS)
def test_density_integrates_to_one_over_the_sphere(model: BRDF, polar: float) -> None:
    wo = view(polar)
    u = torch.rand(20_000, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    for kappa in corners(model, torch.float64):
        wi = model.sample(kappa, wo, u)
        upper = torch.cat((wi[:, :2], wi[:, 2:].abs()), dim=1)
        grid = Grid.around(upper, 12, 24)

        def folded(w: Tensor, kappa: Tensor = kappa) -> Tensor:
            return model.pdf(kappa, w, wo) + model.pdf(kappa, w * DOWN, wo)

        total = float(grid.integrate(folded, len(u), grid.counts(upper)).sum())
        assert total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("model", ALL_MODELS)
def test_finite_at_the_edges_of_everything(model: BRDF, dtype: torch.dtype) -> None:
    edge = torch.tensor([0.0, 1e-7, 0.5, 1.0 - torch.finfo(dtype).eps / 2.0], dtype=dtype)
    u = torch.cartesian_prod(edge, edge, edge)
    kappa = corners(model, dtype)[:, None]
    for polar in (0.0, 45.0, 89.0, 89.94):
        wi = model.sample(kappa, view(polar, dtype), u)
        wi = wi.expand(torch.broadcast_shapes(wi.shape, (len(kappa), len(u), 3)))
        density = model.pdf(kappa, wi, view(polar, dtype))
        assert wi.dtype == density.dtype == dtype
        torch.testing.assert_close(wi.norm(dim=-1), torch.ones_like(wi[..., 0]), atol=1e-5, rtol=0)
        assert bool((density.isfinite() & (density >= 0.0)).all())


@pytest.mark.parametrize("model", ALL_MODELS)
def test_finite_at_opposite_directions(model: BRDF) -> None:
    wi = upper_directions(50, seed=2) * -1.0
    density = model.pdf(corners(model, torch.float64)[:, None], wi, -wi)
    assert bool((density.isfinite() & (density >= 0.0)).all())


@pytest.mark.parametrize("model", ALL_MODELS)
def test_shapes_broadcast(model: BRDF) -> None:
    kappa = corners(model, torch.float64)
    u = torch.rand(7, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    wo = upper_directions(7, seed=4)
    grid = model.sample(kappa[:, None], wo, u).expand(len(kappa), 7, 3)
    density = model.pdf(kappa[:, None], grid, wo)
    assert density.shape == (len(kappa), 7)
    single = model.sample(kappa[-1], wo[2], u[2])
    torch.testing.assert_close(single, grid[-1, 2])
    torch.testing.assert_close(model.pdf(kappa[-1], single, wo[2]), density[-1, 2])


def test_visible_half_vectors_are_those_of_the_v_groove_model() -> None:
    """pdf(h) = G1(wo, h) <wo.h> D(h) / cos_theta_o [Heitz and d'Eon 2014]."""
    alpha = torch.tensor(0.4, dtype=torch.float64)
    wo = upper_directions(200, seed=5)
    u = torch.rand(200, 3, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    wi = reflect_about_visible(square_to_beckmann(u[:, 1:], alpha, alpha), wo, u[:, 0])
    h = unit_half_vector(wi, wo)
    cos_theta_d = (h * wo).sum(dim=1)
    assert bool((cos_theta_d > 0.0).all())
    found = visible_pdf(square_to_beckmann_pdf(h, alpha, alpha), h, wo)
    d = square_to_beckmann_pdf(h, alpha, alpha) / h[:, 2]
    masking = (2.0 * h[:, 2] * wo[:, 2] / cos_theta_d).clamp(max=1.0)
    torch.testing.assert_close(found, masking * d / (4.0 * wo[:, 2]))


@pytest.mark.parametrize("model", ALL_MODELS)
def test_no_sample_weighs_more_than_the_model_says(model: BRDF) -> None:
    wo = upper_directions(2000, seed=7, min_cos=math.cos(math.radians(85.0)))
    u = torch.rand(2000, 3, generator=torch.Generator().manual_seed(8), dtype=torch.float64)
    for kappa in parameter_grid(model, (0.0, 0.5, 1.0)):
        wi = model.sample(kappa, wo, u)
        value = model.eval(kappa, wi, wo) * wi[:, 2].clamp(min=0.0)
        heaviest = float((value / model.pdf(kappa, wi, wo)).max())
        assert heaviest <= model.largest_weight + 1e-6, (
            f"raise largest_weight, or sample closer to the lobe at {kappa.tolist()}"
        )
