"""Measured glossy materials: no made-up light, the body kept, nearer than one GGX + Lambert."""

from __future__ import annotations

import pytest

from spmm_torch.fit import fit
from tests.glossy import (
    FOUR_LOBES,
    figures,
    ggx_and_lambert,
    material,
    material_names,
    of_model,
)
from tests.locations import needs_data

pytestmark = [pytest.mark.slow, needs_data("rgl_brdfs.npz")]
NAMES = (
    "aurora_white",
    "chm_orange",
    "chm_light_blue",
    "cc_ibiza_sunset",
    "ilm_solo_m_68",
    "vch_silk_blue",
    "irid_flake_paint1",
)
# Bounds of white-sky reflectance over that of the material, without those that no grid tells.
ALBEDO = (0.5, 1.5)
BODY = {"irid_flake_paint1": 12.0}
USUAL_BODY = 15.0


# The finer grid for one, for the sake of time; tests/benchmarks/glossy_materials.py fits all.
@pytest.mark.parametrize(
    ("name", "grid"),
    [*((name, 81) for name in NAMES), ("irid_flake_paint1", 151)],
)
def test_a_material_between_its_samples(name: str, grid: int) -> None:
    own = material(name, grid)
    result = fit(own.btf(), FOUR_LOBES, render=False)
    found = figures(own, of_model(result.model))
    simple = [figures(own, ggx_and_lambert(own, seen=seen)) for seen in (True, False)]
    assert found.between > max(each.between for each in simple)
    assert found.mirror > max(each.mirror for each in simple)
    assert found.body >= BODY.get(name, USUAL_BODY)
    assert all(ALBEDO[0] <= ratio <= ALBEDO[1] for ratio in found.albedo)
    assert result.report["objective"]["error"] == "cube-root"
    assert result.report["objective"]["chosen_by"] == "data"


def test_the_names_are_those_of_the_data() -> None:
    assert tuple(material_names()) == NAMES
