"""Unrelated materials in one fit: each kind as its own objective has it, and one model of all."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.evaluate.sums import squared_errors
from spmm_torch.fit import FitResult, fit
from spmm_torch.fit.glossy import objective
from spmm_torch.fit.glossy.kinds import (
    DIELECTRIC,
    GLOSSY,
    MATT,
    METAL,
    PLAIN,
    Kind,
    has_kinds,
    kinds,
)
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.glossy.peaks import DIELECTRIC as DIELECTRIC_F0
from spmm_torch.fit.glossy.peaks import METAL as METAL_F0
from spmm_torch.fit.glossy.trial import STEPS
from spmm_torch.fit.load import load, posed_apart
from spmm_torch.fit.solved import Solved, joined, joined_components
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.metrics import Totals, snr_db
from spmm_torch.model.components import encode_coefficients
from spmm_torch.runtime.context import Context
from spmm_torch.solvers.status import StatusCounts
from tests.fit.glossy.test_objective import TWO_LOBES
from tests.fit.glossy.test_peaks import GRID, WIDTH, lobe, samples
from tests.planted.btfs import tabulated, texel_btf
from tests.planted.models import planted_model, with_components

CPU = torch.device("cpu")
QUICK: dict[str, Any] = {
    "search": {"models": ["lambertian", "oren_nayar", "cook_torrance"], "exchanges": 0},
    "residual": {"rank": 2},
}


def matt(brightness: float) -> Tensor:
    """Values `[1, 3, D]` of a dull surface that leans to one side."""
    wi, wo = GRID.at(torch.arange(GRID.pair_count))
    value = wi[:, 2] * (1.0 + 0.3 * wo[:, 0])
    return (brightness * value)[None, None].expand(1, 3, -1)


MATERIALS = (
    matt(0.2),
    samples(lobe(0.01, DIELECTRIC_F0)),
    matt(0.1),
    samples(lobe(0.012, METAL_F0)),
    samples(lobe(1.5 * WIDTH, METAL_F0)),
    samples(lobe(0.012, DIELECTRIC_F0)),
)
# Beside this peak, two lobes have no room for the body.
LOST = samples(lobe(1.2 * WIDTH, 0.5), 0.0) + samples(lobe(3.0 * WIDTH, 0.04), 0.003)
KINDS = {MATT: [0, 2], DIELECTRIC: [1, 5], METAL: [3], PLAIN: [4]}


def named(*values: Tensor) -> BTF:
    """A BTF of materials that are no neighbours."""
    btf = texel_btf(torch.cat(values).transpose(1, 2), ring_directions())
    return replace(btf, names=tuple(f"material {index}" for index in range(len(values))))


@cache
def fitted() -> FitResult:
    return fit(named(*MATERIALS), FitConfig.from_dict(QUICK), render=False)


def known_kinds(btf: BTF, config: FitConfig) -> list[Kind]:
    """The kinds of all materials, whose steps are all counted."""
    counts: list[int] = []
    found = kinds(btf, config, CPU, counts.append)
    assert sum(counts) == STEPS * btf.texel_count
    return found


def test_each_kind_minimizes_the_errors_that_its_trial_chose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Some of a kind were tried again, with another outcome for all of it."""
    monkeypatch.setattr(objective, "best_error", lambda *given: pytest.fail("a second trial"))
    btf, config = named(MATERIALS[4], LOST, MATERIALS[3]), FitConfig.from_dict(TWO_LOBES)
    loaded = load(btf, config, Context.build("cpu"), None)
    chosen = {
        problem.objective.error: texels.tolist() for texels, problem in posed_apart(loaded, config)
    }
    assert chosen == {"l2": [0], "balanced": [1], "cube-root": [2]}
    assert loaded.context.watch.seconds["objective"] > 0.0


def texel_snr(model: SPMM, values: Tensor, texel: int) -> float:
    wi, wo = GRID.at(torch.arange(GRID.pair_count))
    place = torch.tensor([(texel + 0.5) / model.width, 0.5]).expand(len(wi), 2)
    with torch.no_grad():
        error = (model(place, wi, wo).T - values[0]).square().sum()
    return snr_db(float(values.square().sum()), float(error))


def test_the_kinds_are_found() -> None:
    btf = named(*MATERIALS)
    found = known_kinds(btf, FitConfig())
    assert {kind.name: kind.texels.tolist() for kind in found} == KINDS
    assert [len(kind.texels) for kind in found] == [2, 2, 1, 1]
    pair = known_kinds(named(MATERIALS[4], LOST), FitConfig.from_dict(TWO_LOBES))
    assert {kind.name: kind.texels.tolist() for kind in pair} == {PLAIN: [0], GLOSSY: [1]}
    part = found[0].part(btf)
    assert part.names == tuple(f"material {texel}" for texel in found[0].texels.tolist())
    assert part.texels().equal(btf.texels(found[0].texels))


@pytest.mark.parametrize(
    "changes", [{"weights": {"error": "l2"}}, {"search": {"method": "stagewise"}}, {"auto": True}]
)
def test_what_the_settings_say_is_for_all(changes: dict[str, Any]) -> None:
    config = FitConfig.from_dict(changes)
    assert has_kinds(named(*MATERIALS), FitConfig())
    assert not has_kinds(named(*MATERIALS), config)
    assert not has_kinds(replace(named(*MATERIALS), names=None), FitConfig())


def test_one_model_has_the_errors_of_its_parts() -> None:
    result, btf = fitted(), named(*MATERIALS)
    every = torch.ones(btf.pair_count, dtype=torch.bool)
    totals = squared_errors(result.model, btf, every).totals(every).snr_db()
    for key in ("without_residual", "with_residual"):
        assert totals[key] == pytest.approx(result.report["snr_db"][key], abs=0.05)
    assert result.report["objective"]["narrow_lobes"] > 0
    assert set(result.report["objective"]["error"].split(", ")) >= {"l2", "cube-root"}
    loaded = SPMM.from_tensors(*result.model.to_tensors())
    assert texel_snr(loaded, MATERIALS[5], 5) == texel_snr(result.model, MATERIALS[5], 5)


@pytest.mark.slow
def test_errors_by_weight_are_in_the_unit_of_the_input() -> None:
    """Those of weighted kinds were in the unit of the fit, beside others in that of the values."""
    search = {"max_lobes": 2, "exchanges": 0, "restarts": 1, "bank_normals": 8}
    search |= {"models": ["lambertian", "cook_torrance"]}
    config, materials = FitConfig.from_dict({"search": search}), (matt(0.2), LOST)
    known, found = (
        fit(named(*(unit * values for values in materials)), config, render=False).report
        for unit in (1.0, 1e-25)
    )
    assert known["objective"]["error"] == found["objective"]["error"] == "l2, balanced"
    wanted = pytest.approx(known["weighted_snr_db"]["without_residual"], abs=0.1)
    assert found["weighted_snr_db"]["without_residual"] == wanted


def test_a_material_is_no_worse_than_alone() -> None:
    alone = fit(named(MATERIALS[0]), FitConfig.from_dict(QUICK), render=False).model
    least = min(60.0, texel_snr(alone, MATERIALS[0], 0) - 1.0)
    assert texel_snr(fitted().model, MATERIALS[0], 0) > least


def part_of(seed: int, unit: float) -> Solved:
    """A model of one texel whose weights are in a unit of their own, as the fit of a kind."""
    model = planted_model(size=1, clusters=1, seed=seed)
    with torch.no_grad():
        model.weight.mul_(unit)
    model.weight_type = torch.int16
    none, one = torch.zeros(3, dtype=torch.long), Totals(1.0, 0.5, 0.5, 0.5)
    return Solved(model, one, None, (Objective(),), none, StatusCounts.none(), torch.tensor([0]), 1)


@pytest.mark.parametrize(
    ("unit", "kind"), [(1.0, torch.int16), (1e-4, torch.int16), (1e-12, torch.float32)]
)
def test_parts_in_units_far_apart_keep_their_weights(unit: float, kind: torch.dtype) -> None:
    """One scale of two bytes holds nine decades: smaller weights became 0."""
    parts = [part_of(1, 1.0), part_of(2, unit)]
    places = [torch.tensor([0]), torch.tensor([1])]
    whole = joined(parts, places, named(*MATERIALS[:2])).model
    assert whole.weight_type == kind
    for place, part in zip(places, parts, strict=True):
        found, own = whole.sparse_weights.of(place), part.model.sparse_weights
        torch.testing.assert_close(
            found.weight.sort(0).values, own.weight.sort(0).values, rtol=1e-3, atol=0.0
        )


def test_components_of_several_formats_keep_their_values() -> None:
    as_bytes, other = (with_components(planted_model(size=2, seed=seed)) for seed in (1, 2))
    exact = other.components.coefficients()
    code, scale = encode_coefficients(exact, torch.float16)
    other.components = other.components.with_codes(coefficient=code, coefficient_scale=scale)
    found = joined_components([as_bytes, other], torch.arange(8), tabulated(as_bytes))
    rank = as_bytes.components.rank
    expected = as_bytes.components.coefficients()
    torch.testing.assert_close(found.coefficients()[:4, :rank], expected)
    torch.testing.assert_close(found.coefficients()[4:, rank:], exact, rtol=1e-3, atol=1e-4)
