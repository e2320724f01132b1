"""GGX against Mitsuba's own microfacets: distribution, Smith's term, and density of samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.synthesize.variant import PLAIN
from tests.brdf.brdf_cases import near_mirror, upper_directions

pytest.importorskip("mitsuba", reason="needs the extra: pip install 'spmm_torch[mitsuba]'")

GGX = REGISTRY[MODEL_NAMES.index("ggx")]
RELATIVE_ERROR = 2e-5  # Mitsuba computes in float32


def value_and_density(facets: Any, wi: np.ndarray, wo: np.ndarray) -> tuple[float, float]:
    """f_r without Fresnel term, and the density of wi sampled by visible normals.

    Mitsuba multiplies the masking of both directions as if they were independent; that of
    correlated heights follows from its two factors, 1 / G = 1 / G1(wi) + 1 / G1(wo) - 1.
    """
    h = (wi + wo) / np.linalg.norm(wi + wo)
    masking_i, masking_o = facets.smith_g1(wi, h), facets.smith_g1(wo, h)
    masking = 1.0 / (1.0 / masking_i + 1.0 / masking_o - 1.0)
    value = facets.eval(h) * masking / (4.0 * wi[2] * wo[2])
    return value, facets.pdf(wo, h) / (4.0 * float(h @ wo))


@pytest.mark.parametrize("alpha", [(0.5, 0.5), (0.1, 0.6), (0.9, 0.2), (0.03, 0.03)])
def test_mitsuba_agrees(alpha: tuple[float, float]) -> None:
    import mitsuba

    mitsuba.set_variant(PLAIN)
    facets = mitsuba.MicrofacetDistribution(mitsuba.MicrofacetType.GGX, *alpha, True)
    wo = upper_directions(200, seed=1)
    wi = near_mirror(wo, max(alpha), seed=2)
    pairs = zip(wi.numpy(), wo.numpy(), strict=True)
    value, density = np.array([value_and_density(facets, *pair) for pair in pairs]).T
    kappa = torch.tensor((*alpha, 1.0), dtype=torch.float64)  # f0 of 1: all is reflected
    np.testing.assert_allclose(GGX.eval(kappa, wi, wo).numpy(), value, rtol=RELATIVE_ERROR)
    np.testing.assert_allclose(GGX.pdf(kappa, wi, wo).numpy(), density, rtol=RELATIVE_ERROR)
