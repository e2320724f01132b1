"""Mitsuba's own chi-square test of the whole mixture: samples have the density that is told."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.mitsuba.material import BILINEAR, STOCHASTIC
from tests.lobes.lobe_cases import kappa_of_widths, unit_vector
from tests.planted.models import (
    FEW_RINGS,
    planted_model,
    uneven_model,
    with_components,
    with_relief,
)
from tests.planted.runs import model_folder

LOOKUPS = [
    *((BILINEAR, degrees) for degrees in (0.0, 25.0, 45.0, 65.0, 80.0)),
    *((STOCHASTIC, degrees) for degrees in (25.0, 65.0)),
]
# Over all tests below together, by Sidak's correction.
SIGNIFICANCE = 0.01
RINGS = ring_directions(FEW_RINGS)
# Mitsuba integrates by the trapezoid rule in even cells, which resolves no lobe much narrower.
WIDTH = 0.2


def of_width(model: SPMM, width: float = WIDTH) -> SPMM:
    """The model with lobes of one width, narrow enough to be sampled."""
    with_width = model.kappa.detach().clone()
    for lobe, index in enumerate(model.lobe_model.tolist()):
        kappa = kappa_of_widths(REGISTRY[index], (width, width))
        with_width[lobe, : len(kappa)] = with_width.new_tensor(kappa)
    model.kappa.data.copy_(with_width)
    return model


MATERIALS = {
    "every BRDF": lambda: of_width(uneven_model([9, 9, 9, 9], 2, RINGS, RINGS, names=MODEL_NAMES)),
    "components": lambda: of_width(with_components(planted_model(size=4), rank=3)),
    "relief": lambda: of_width(with_relief(planted_model(size=8, names=("ggx", "ward")))),
}
TESTS = len(MATERIALS) * len(LOOKUPS)


@pytest.fixture(params=MATERIALS, scope="module")
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    model = MATERIALS[request.param]()
    assert len(model.sampling_data().index) > 0
    return model_folder(tmp_path_factory.mktemp("model") / "run", model)


@pytest.mark.slow
@pytest.mark.parametrize(("filter_type", "degrees"), LOOKUPS)
def test_mitsuba_accepts_the_mixture(filter_type: str, degrees: float, run: Path, mi: Any) -> None:
    chi2: Any = import_module("mitsuba.chi2")
    wi = unit_vector(degrees, 0.3).tolist()
    # Of one uv and view, a stochastic lookup always draws the same texel.
    plugin = {"type": "spmm", "filename": str(run), "filter_type": filter_type}
    functors = chi2.BSDFAdapter("spmm", plugin, wi=wi, uv=[0.3, 0.6])
    judge = chi2.ChiSquareTest(
        chi2.SphericalDomain(), *functors, 3, sample_count=200_000, res=101, ires=8
    )
    assert judge.run(SIGNIFICANCE, TESTS, quiet=True), judge.messages
