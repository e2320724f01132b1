"""Weights and residual fit to the pictures: what is reported, what gets better, what resumes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.data.error_weights import Weights
from spmm_torch.evaluate.sums import squared_errors
from spmm_torch.fit import FitResult, align, fit
from spmm_torch.fit.refit import stage, turns
from spmm_torch.fit.relief.estimate import Estimate
from spmm_torch.geometry.directions import MIRROR, direction_pairs, ring_directions
from spmm_torch.geometry.relief import texel_centres
from spmm_torch.metrics import snr_db
from spmm_torch.model.components import encode_functions
from spmm_torch.model.lookup import SparseWeights
from spmm_torch.report import check_report
from spmm_torch.runtime.checkpoint import Checkpoint
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Stage
from spmm_torch.solvers.status import StatusCounts
from tests.planted.btfs import tabulated, texel_btf
from tests.planted.models import planted_model
from tests.planted.reliefs import PlantedRelief, planted_relief

SIDE = 9
VIEW = ring_directions(((0.0, 1), (30.0, 5), (55.0, 7)))
LIGHT = ring_directions(((20.0, 3), (50.0, 5)))
SETTINGS: dict[str, Any] = {
    "cluster": {"count": 3, "components": 6},
    "sample": {"per_cluster": 2},
    "search": {
        "models": ["lambertian", "ward"],
        "max_lobes": 2,
        "restarts": 1,
        "bank_normals": 16,
        "exchanges": 0,
        "final_steps": 4,
    },
    "residual": {"rank": 3},
    "storage": {"weights": "float32"},
    "device": "cpu",
}
RANK_0 = ["residual.rank=0", "residual.joint=false"]


def config(*assignments: str) -> FitConfig:
    return FitConfig.from_dict(SETTINGS).override(list(assignments))


@pytest.fixture(scope="module")
def planted() -> PlantedRelief:
    """Pictures of heights that are deep enough to show other texels, and drift."""
    drift = 2.0 * torch.rand(len(VIEW), 2, generator=torch.Generator().manual_seed(3)) - 1.0
    return planted_relief(
        0.03, 0.05, drift, size=(SIDE, SIDE), views=VIEW, lights=LIGHT, noise=0.05
    )


@pytest.fixture
def known(planted: PlantedRelief, monkeypatch: pytest.MonkeyPatch) -> BTF:
    """The BTF, whose relief is found by whoever asks."""
    drift = planted.drift / torch.tensor([SIDE, -SIDE])
    found = Estimate(planted.height, drift, MIRROR)
    monkeypatch.setattr(align, "estimate_relief", lambda *_, **__: found)
    return planted.btf


@torch.no_grad()
def table(model: SPMM, residual: bool) -> Tensor:
    """The model `[T, D, C]` at what each picture shows at each texel, as anybody would ask."""
    wi, wo = direction_pairs(model.light, model.view)
    uv = texel_centres(model.height, model.width, wi)[:, None]  # [T, 1, 2]
    if model.relief is not None and model.relief.drift is not None:
        uv = uv + model.relief.drift.repeat_interleave(len(model.light), 0)
    uv = uv.expand(-1, len(wi), -1)
    return model(uv, wi.expand(len(uv), -1, -1), wo.expand(len(uv), -1, -1), residual=residual)


def check_errors(btf: BTF, result: FitResult, weights: Weights | None = None) -> None:
    """Reported errors are those of the saved model, to a thousandth of a decibel."""
    report = result.report
    check_report(report)
    model = result.model
    every = torch.ones(btf.pair_count, dtype=torch.bool)
    measured = every if btf.measured is None else btf.measured
    totals = squared_errors(model, btf, measured).totals(measured)
    for name in ("without_residual", "with_residual", "cluster_mean"):
        own = snr_db(totals.energy, getattr(totals, name))
        assert report["snr_db"][name] == pytest.approx(own, abs=1e-3), name
    if weights is None:
        return
    values = btf.texels().double()
    share = measured.double()[None, :, None]
    share = share if weights.pair is None else weights.pair.double()[None, :, None]
    if weights.texel is not None:
        share = share * weights.texel.double()[:, None, None]
    energy = float((share * values.square()).sum())
    for name, residual in (("without_residual", False), ("with_residual", True)):
        error = float((share * (table(model, residual).double() - values).square()).sum())
        own = snr_db(energy, error)
        assert report["weighted_snr_db"][name] == pytest.approx(own, abs=1e-3), name
    labels = model.labels
    error = 0.0
    for k in range(model.cluster_count):
        part, own = values[labels == k], share.expand(len(values), -1, -1)[labels == k]
        mean = (own * part).sum(0) / own.sum(0).clamp(min=1e-30)
        error += float((own * (part - mean).square()).sum())
    own = snr_db(energy, error)
    assert report["weighted_snr_db"]["cluster_mean"] == pytest.approx(own, abs=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["residual.clusters=true"],
        ["residual.joint=false"],
        RANK_0,
        [*RANK_0, "residual.clusters=true"],
        ["storage.weights=byte"],
        ["storage.weights=int16"],
        ["storage.weights=auto"],
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("surface", ["relief", "flat"])
def test_reported_errors_are_those_of_the_model(
    known: BTF, changes: list[str], surface: str
) -> None:
    mode = ["relief.mode=off"] if surface == "flat" else []
    result = fit(known, config(*changes, *mode), render=False)
    check_errors(known, result)
    model = result.model
    assert (model.relief is None) == (surface == "flat")
    assert (model.components is None) == ("residual.rank=0" in changes)
    assert result.report["weighted_snr_db"] is None


def some_weights(btf: BTF, pair: bool, texel: bool) -> Weights:
    generator = torch.Generator().manual_seed(8)
    pairs = torch.rand(len(VIEW), len(LIGHT), generator=generator)
    texels = torch.rand(SIDE, SIDE, generator=generator)
    return Weights.build(btf, pairs if pair else None, texels if texel else None)


@pytest.mark.parametrize("changes", [[], ["residual.clusters=true"], RANK_0], ids=" ".join)
@pytest.mark.parametrize(("pair", "texel"), [(True, True), (True, False), (False, True)])
def test_both_errors_are_reported_by_weight(
    known: BTF, changes: list[str], pair: bool, texel: bool
) -> None:
    weights = some_weights(known, pair, texel)
    check_errors(known, fit(known, config(*changes), weights=weights, render=False), weights)


@pytest.mark.parametrize("changes", [[], ["residual.clusters=true"], RANK_0], ids=" ".join)
def test_pairs_that_are_missing_do_not_count(known: BTF, changes: list[str]) -> None:
    gaps = torch.rand(len(VIEW), len(LIGHT), generator=torch.Generator().manual_seed(2)) < 0.15
    values = known.texels().unflatten(1, gaps.shape) * ~gaps[None, :, :, None]
    pictures = values.permute(1, 2, 0, 3).unflatten(2, (SIDE, SIDE))
    btf = replace(BTF.from_values(pictures, VIEW, LIGHT), missing=gaps)
    result = fit(btf, config(*changes), render=False)
    check_errors(btf, result, Weights.build(btf))
    # Between the measured pairs the whole model is as near to what was there.
    truth, found = known.texels()[:, gaps.flatten()], table(result.model, True)[:, gaps.flatten()]
    wrong = float((found - truth).square().sum() / truth.square().sum())
    assert -10.0 * math.log10(wrong) > result.report["snr_db"]["with_residual"] - 6.0


def test_weights_are_never_worse_than_before(known: BTF, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = []

    def recorded(
        system: stage.System, entries: SparseWeights, steps: int
    ) -> tuple[SparseWeights, StatusCounts]:
        found, counts = solve(system, entries, steps)
        errors.append((system.error(entries.weight), system.error(found.weight)))
        return found, counts

    solve = stage._weights
    monkeypatch.setattr(stage, "_weights", recorded)
    for steps in (0, 1, 40):
        fit(known, config(*RANK_0, f"refit.steps={steps}"), render=False)
    before, after = torch.tensor(errors, dtype=torch.float64).T
    assert before[0] == after[0]
    assert (after[1:] < before[1:]).all()
    assert after[2] <= after[1]


def test_a_residual_takes_away_more_with_its_rank_and_beside_it(known: BTF) -> None:
    def errors(*changes: str) -> tuple[float, float]:
        same = ["residual.joint=false", "cluster.components=10"]  # of 10, whatever the rank
        snr = fit(known, config(*same, *changes), render=False).report["snr_db"]
        return snr["without_residual"], snr["with_residual"]

    few, more = errors("residual.rank=1"), errors("residual.rank=5")
    both = errors("residual.rank=5", "residual.clusters=true")
    assert few[0] == pytest.approx(more[0], abs=0.02) == both[0]
    assert few[0] < few[1] < more[1]
    assert both[1] >= more[1] - 0.01


def test_the_pictures_are_met_better_through_their_relief(known: BTF) -> None:
    through, flat = (
        fit(known, config("residual.rank=0", "residual.clusters=true", *mode), render=False)
        for mode in ([], ["relief.mode=off"])
    )
    for name in ("without_residual", "with_residual"):
        assert through.report["snr_db"][name] > flat.report["snr_db"][name] + 1.0


KEPT = ["relief", "cluster", "search", "pictures", "sweep-0", "sweep-1"]


@pytest.mark.parametrize("last", KEPT)
def test_a_run_that_was_stopped_goes_on(
    known: BTF, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str
) -> None:
    """It gives the same bytes, and computes nothing again that was kept."""
    settings = config("residual.clusters=true", "storage.weights=auto", "refit.sweeps=2")
    unbroken = fit(known, settings, render=False).model.pack()
    keep, names = Checkpoint._keep, []

    def stopping(self: Checkpoint, name: str, *arguments: Any) -> None:
        keep(self, name, *arguments)
        names.append(name)
        if name == last:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "_keep", stopping)
    with pytest.raises(KeyboardInterrupt):
        fit(known, settings, Context.build("cpu", state=tmp_path), render=False)
    before = list(names)
    monkeypatch.setattr(Checkpoint, "_keep", lambda self, name, *_: names.append(name))
    result = fit(known, settings, Context.build("cpu", state=tmp_path), render=False)
    assert result.model.pack() == unbroken
    assert len(set(names)) == len(names) and set(KEPT) <= set(names) and last in before
    check_errors(known, result)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize(
    "changes",
    [[], ["residual.clusters=true"], RANK_0, [*RANK_0, "residual.clusters=true"]],
    ids=" ".join,
)
def test_the_progress_counts_every_pass_over_the_pictures(
    known: BTF, changes: list[str], weighted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: dict[str, tuple[int, int | None]] = {}
    monkeypatch.setattr(
        Stage, "end", lambda self, _outcome: counts.update({self.name: (self.done, self.total)})
    )
    weights = some_weights(known, True, True) if weighted else None
    fit(known, config(*changes), weights=weights, render=False)
    done, total = counts["pictures"]
    assert done == total


def test_weights_of_an_exact_fit_stay_exact() -> None:
    """Loss by rounding cannot be told there by the algebra of float32 products."""
    lobes = planted_model(6, 1, 1, 2, rings=((0.0, 1), (40.0, 6)), names=("lambertian", "ward"))
    btf = tabulated(lobes)
    changes = ["storage.weights=auto", "relief.mode=off", "search.final_steps=40"]
    result = fit(btf, config(*changes), render=False)
    check_errors(btf, result)
    assert result.report["snr_db"]["without_residual"] > 65.0
    assert result.model.weight_type == torch.float32


def test_functions_beyond_bytes_leave_coefficients_in_bytes(
    known: BTF, monkeypatch: pytest.MonkeyPatch
) -> None:
    def coarse(values: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        code, scale = encode_functions(values, dtype)
        return (code, 1.5 * scale) if dtype == torch.int8 else (code, scale)

    as_bytes = fit(known, config(), render=False)
    monkeypatch.setattr(turns, "encode_functions", coarse)
    result = fit(known, config(), render=False)
    check_errors(known, result)
    for found, kind in ((as_bytes, torch.int8), (result, torch.float16)):
        components = found.model.components
        assert components is not None
        assert components.code.dtype == kind
        assert components.coefficient.dtype == torch.int8


@pytest.mark.parametrize(
    "changes",
    [
        ["residual.rank=4"],
        ["residual.rank=0", "residual.clusters=true", "residual.alternations=60"],
    ],
    ids=" ".join,
)
def test_rounded_weights_cost_no_figure_anything_beside_a_residual_that_is_nearly_all(
    changes: list[str],
) -> None:
    """Lobes alone, whose error is large, would take bytes."""
    lobes = planted_model(6, 1, 1, 2, rings=((0.0, 1), (40.0, 6)), names=("lambertian",))
    btf = tabulated(lobes)
    values = btf.texels()
    unlike_lobes = torch.rand(values.shape[1:], generator=torch.Generator().manual_seed(2))
    btf = texel_btf(values + 0.1 * unlike_lobes, btf.light, btf.view, btf.height)
    settings = ["relief.mode=off", "cluster.count=1", "select.max_lobes=1", *changes]
    exact, chosen = (
        fit(btf, config(*settings, f"storage.weights={kind}"), render=False).report["snr_db"]
        for kind in ("float32", "auto")
    )
    assert exact["without_residual"] < 20.0 < 35.0 < exact["with_residual"]
    for name, decibels in exact.items():
        assert chosen[name] >= decibels - 0.02, name
