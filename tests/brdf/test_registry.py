"""The registry and its parameter tables."""

from __future__ import annotations

import math

import pytest
import torch
from brdf_cases import ALL_MODELS
from numpy_twins import TWINS

from spmm_torch.brdf import BRDF, MAX_PARAMETERS, MODEL_NAMES, PAPER_MODELS, REGISTRY, Parameter

ROWS = [
    pytest.param(row, id=f"{model.name}-{row.name}")
    for model in REGISTRY
    for row in model.parameters
]
WIDTH_ROWS = [param for param in ROWS if param.values[0].from_width is not None]


def test_names_are_unique_and_in_order() -> None:
    assert len(set(MODEL_NAMES)) == len(REGISTRY)
    assert PAPER_MODELS == (
        "lambertian",
        "oren_nayar",
        "blinn_phong",
        "ward",
        "cook_torrance",
        "lafortune",
        "ashikhmin_shirley",
    )
    assert max(len(model.parameters) for model in REGISTRY) == MAX_PARAMETERS


def test_every_model_has_a_twin() -> None:
    assert set(TWINS) == set(MODEL_NAMES)


@pytest.mark.parametrize("model", ALL_MODELS)
def test_parameter_names_are_unique_and_documented(model: BRDF) -> None:
    names = [row.name for row in model.parameters]
    assert len(set(names)) == len(names)
    assert all(name in (type(model).__doc__ or "") for name in names)


@pytest.mark.parametrize("row", ROWS)
def test_bounds_and_scale(row: Parameter) -> None:
    assert row.low < row.high
    assert row.scale in ("linear", "log")
    assert row.scale == "linear" or row.low > 0.0
    assert row.meaning


@pytest.mark.parametrize("row", ROWS)
def test_unit_scale_is_inverse_and_hits_the_bounds(row: Parameter) -> None:
    unit = torch.linspace(0.0, 1.0, 11, dtype=torch.float64)
    value = row.from_unit(unit)
    torch.testing.assert_close(row.to_unit(value), unit, rtol=0.0, atol=1e-12)
    torch.testing.assert_close(float(value[0]), row.low)
    torch.testing.assert_close(float(value[-1]), row.high)
    assert bool((value.diff() > 0.0).all())


@pytest.mark.parametrize("row", WIDTH_ROWS)
def test_width_is_monotone_and_lies_in_the_box(row: Parameter) -> None:
    assert row.from_width is not None
    widths = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8]
    values = [row.from_width(width) for width in widths]
    assert values in (sorted(values), sorted(values, reverse=True))
    assert len(set(values)) == len(values)
    assert all(row.low <= value <= row.high for value in values)


@pytest.mark.parametrize(
    "model", [p for p in ALL_MODELS if p.id not in ("lambertian", "oren_nayar")]
)
def test_width_is_the_slope_at_which_the_lobe_has_fallen(model: BRDF) -> None:
    """At normal view, the half vector tilted by the width gives 1/e of the peak."""
    width = 0.05
    kappa = torch.tensor(
        [row.from_width(width) if row.from_width else row.high for row in model.parameters],
        dtype=torch.float64,
    )
    if model.name == "lafortune":
        kappa[0] = -1.0
    angle = torch.tensor([0.0, 2.0 * math.atan(width)], dtype=torch.float64)
    wi = torch.stack((torch.sin(angle), torch.zeros(2, dtype=torch.float64), torch.cos(angle)), -1)
    wo = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    peak, side = model.eval(kappa, wi, wo)
    assert float(side / peak) == pytest.approx(math.exp(-1.0), rel=0.03)
