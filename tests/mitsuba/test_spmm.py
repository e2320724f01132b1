"""The plug-in `spmm` against the model in torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import MIRROR, ring_directions
from spmm_torch.mitsuba.brdf import TWINS
from tests.mitsuba.queries import interaction, random_queries, values, vectors
from tests.planted.models import (
    FEW_RINGS,
    FINE_RINGS,
    planted_model,
    planted_relief,
    uneven_model,
    with_components,
    with_relief,
)
from tests.planted.runs import model_folder

QUERIES = 10_000
RINGS = ring_directions(FEW_RINGS)


def every_brdf() -> SPMM:
    """Texels of no lobe and of one to nine, in a texture that is wider than high."""
    model = uneven_model([0, 9, 4, 2, 7, 1], 2, RINGS, RINGS, names=MODEL_NAMES)
    return with_components(model, rank=5, beside=True)


# Each is a kernel of its own, and takes seconds to compile.
MODELS = {
    "every BRDF, both residuals": every_brdf,
    "lobes alone": lambda: planted_model(size=4, names=("ward",)),
    "none to sample": lambda: planted_model(size=4, names=("lambertian", "oren_nayar")),
    "none at all": lambda: with_components(uneven_model([0] * 4, 2, RINGS, RINGS), rank=2),
    "relief": lambda: with_relief(planted_model(size=16, rings=FINE_RINGS, residual=0.02)),
    "mirrored relief": lambda: with_relief(
        with_components(planted_model(size=6), rank=20), planted_relief(6, 6, rule=MIRROR)
    ),
}


def test_every_brdf_has_a_twin() -> None:
    assert tuple(TWINS) == MODEL_NAMES


SLOW = ("lobes alone", "relief")


@pytest.mark.parametrize(
    "build",
    [
        pytest.param(build, id=name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name, build in MODELS.items()
    ],
)
def test_values_and_densities_are_those_of_torch(build: Any, mi: Any, tmp_path: Path) -> None:
    hold(mi, build(), tmp_path)


@pytest.mark.gpu(simulated=False)
@pytest.mark.parametrize("build", [pytest.param(build, id=name) for name, build in MODELS.items()])
def test_values_on_a_gpu_are_those_of_torch(build: Any, cuda: Any, tmp_path: Path) -> None:
    hold(cuda, build(), tmp_path)


def hold(mi: Any, model: SPMM, tmp_path: Path) -> None:
    """Holds values and densities of the plug-in to those of torch."""
    run = model_folder(tmp_path / "run", model)
    bsdf = mi.load_dict({"type": "spmm", "filename": str(run)})
    uv, wi, wo = random_queries(QUERIES)
    found = bsdf.eval_pdf(mi.BSDFContext(), interaction(mi, uv, wo), vectors(mi, wi))
    with torch.no_grad():
        expected, density = model(uv, wi, wo), model.pdf(uv, wi, wo)
    torch.testing.assert_close(values(found[0]), expected, rtol=2e-5, atol=2e-6)
    # Narrow lobes magnify the rounding of views that are turned up to the lowest measured one.
    torch.testing.assert_close(values(found[1]), density, rtol=1e-4, atol=2e-6)


def test_samples_weigh_their_value_over_their_density(mi: Any, tmp_path: Path) -> None:
    run = model_folder(tmp_path / "run", planted_model(size=4, names=("ward", "oren_nayar")))
    bsdf, context = mi.load_dict({"type": "spmm", "filename": str(run)}), mi.BSDFContext()
    uv, wi, wo = random_queries(500)
    si, light, numbers = interaction(mi, uv, wo), vectors(mi, wi), torch.rand(3, 500).numpy()
    first, others = mi.Float(numbers[0]), mi.Point2f(numbers[1], numbers[2])
    value, density, drawn, weight = bsdf.eval_pdf_sample(context, si, light, first, others)
    alone, weight_alone = bsdf.sample(context, si, first, others)
    expected, expected_density = bsdf.eval_pdf(context, si, drawn.wo)
    torch.testing.assert_close(values(drawn.wo), values(alone.wo))
    torch.testing.assert_close(values(weight), values(weight_alone))
    torch.testing.assert_close(values(drawn.pdf), values(expected_density), rtol=1e-3, atol=1e-5)
    product = values(weight) * values(drawn.pdf)[:, None]
    torch.testing.assert_close(product, values(expected), rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(values(value), values(bsdf.eval(context, si, light)))
    torch.testing.assert_close(values(density), values(bsdf.pdf(context, si, light)))
