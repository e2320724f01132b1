"""The registry and its parameter tables."""

from __future__ import annotations

import math
import re
import subprocess
import sys

import pytest
import torch

import spmm_torch.brdf
from spmm_torch.brdf import BRDF, MAX_PARAMETERS, MODEL_NAMES, PAPER_MODELS, REGISTRY, Parameter
from spmm_torch.brdf.ggx import GGX
from tests.brdf.brdf_cases import ALL_MODELS
from tests.brdf.numpy_twins import TWINS, twin_of

ROWS = [
    pytest.param(row, id=f"{model.name}-{row.name}")
    for model in REGISTRY
    for row in model.parameters
]
WIDTH_ROWS = [param for param in ROWS if param.values[0].from_width is not None]
WITH_WIDTH = [p for p in ALL_MODELS if any(row.from_width for row in p.values[0].parameters)]
# Imports the names without the package around them, which imports torch itself.
WITHOUT_TORCH = """
import sys
from types import ModuleType
package = sys.modules["spmm_torch"] = ModuleType("spmm_torch")
package.__path__ = [sys.argv[1]]
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.config.fit import FitConfig
assert set(FitConfig().search.models) < set(MODEL_NAMES)
assert "torch" not in sys.modules
"""


def test_names_are_unique_and_in_order() -> None:
    assert len(set(MODEL_NAMES)) == len(REGISTRY)
    assert tuple(model.name for model in REGISTRY) == MODEL_NAMES
    assert len({model.title for model in REGISTRY}) == len(REGISTRY)
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


def test_the_first_eight_are_those_of_format_1() -> None:
    """Programs that read format 1 know these, whatever is added behind them."""
    assert (*PAPER_MODELS, "ward_duer") == MODEL_NAMES[:8]


def test_names_and_settings_need_no_torch() -> None:
    folder = spmm_torch.__path__[0]
    subprocess.run([sys.executable, "-c", WITHOUT_TORCH, folder], check=True, timeout=60)


def test_an_unknown_name_of_the_registry_is_an_error() -> None:
    with pytest.raises(AttributeError, match=r"'spmm_torch.brdf' has no attribute 'MODEL'"):
        _ = spmm_torch.brdf.MODEL


@pytest.mark.parametrize("model", ALL_MODELS)
def test_references_are_full(model: BRDF) -> None:
    """Authors with initials or names, title, venue, and the year at the end."""
    assert model.references
    for reference in model.references:
        assert reference.count(", ") >= 3
        assert re.search(r", (1[789]|20)\d\d\.$", reference)


@pytest.mark.parametrize("model", ALL_MODELS)
def test_shapes_lie_in_the_box(model: BRDF) -> None:
    assert model.shapes
    for shape in (*model.shapes, *model.peak_shapes):
        for value, row in zip(shape, model.parameters, strict=True):
            assert row.low <= value <= row.high, (shape, row.name)


@pytest.mark.parametrize("model", ALL_MODELS)
def test_a_search_starts_from_different_shapes(model: BRDF) -> None:
    """Lobes of equal values would be one start twice."""
    wo = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    wi = torch.tensor([[-0.6, 0.0, 0.8], [-0.5, 0.3, math.sqrt(0.66)]], dtype=torch.float64)
    kappa = torch.tensor(model.shapes, dtype=torch.float64)[:, None]
    values = model.eval(kappa, wi, wo)
    assert len(values.unique(dim=0)) == len(model.shapes)


def test_every_model_has_a_twin() -> None:
    for name in MODEL_NAMES:
        twin_of(name)
    assert set(TWINS) <= set(MODEL_NAMES)


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


@pytest.mark.parametrize("model", WITH_WIDTH)
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


def registered(monkeypatch: pytest.MonkeyPatch, name: str, place: str) -> tuple[BRDF, ...]:
    """The registry of one entry, built anew."""
    monkeypatch.setattr(spmm_torch.brdf, "CLASSES", {name: place})
    for built in ("REGISTRY", "MAX_PARAMETERS"):
        monkeypatch.delitem(vars(spmm_torch.brdf), built)
    return spmm_torch.brdf.REGISTRY


@pytest.mark.parametrize(
    ("name", "place", "complaint"),
    [
        ("ggx", "ggx.Ggx", r"names Ggx, which brdf/ggx.py does not define"),
        ("g-gx", "ggx.GGX", r"^GGX in brdf/ggx.py has the name 'ggx', and 'g-gx' in brdf/__init__"),
    ],
)
def test_a_wrong_entry_is_told(
    monkeypatch: pytest.MonkeyPatch, name: str, place: str, complaint: str
) -> None:
    with pytest.raises(ImportError, match=complaint):
        registered(monkeypatch, name, place)


@pytest.mark.parametrize("attribute", ["shapes", "peak_shapes"])
def test_a_shape_of_another_length_is_told(monkeypatch: pytest.MonkeyPatch, attribute: str) -> None:
    monkeypatch.setattr(GGX, attribute, ((0.1, 0.1, 0.5), (0.1, 0.1)))
    complaint = (
        r"GGX in brdf/ggx.py has the shape \(0.1, 0.1\); expected one value for each of its 3"
    )
    with pytest.raises(ImportError, match=complaint):
        registered(monkeypatch, "ggx", "ggx.GGX")


@pytest.mark.parametrize(
    "attribute", ["title", "references", "shapes", "reciprocal", "anisotropic"]
)
def test_a_missing_attribute_is_told(monkeypatch: pytest.MonkeyPatch, attribute: str) -> None:
    monkeypatch.delattr(GGX, attribute)
    with pytest.raises(ImportError, match=f"GGX in brdf/ggx.py lacks '{attribute}'; define it"):
        registered(monkeypatch, "ggx", "ggx.GGX")


def test_a_missing_twin_is_told() -> None:
    with pytest.raises(AssertionError, match=r"velvet has no twin; add it to TWINS in tests/"):
        twin_of("velvet")
