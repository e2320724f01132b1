"""The whole fit by weight: missing pairs, pairs that do not count, and what is reported."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.data.error_weights import Weights
from spmm_torch.fit import FitResult, fit
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.report import check_report
from tests.planted.btfs import tabulated, texel_btf
from tests.planted.models import planted_model

RINGS = ((0.0, 1), (25.0, 6), (50.0, 10), (75.0, 14))
COUNT = len(ring_directions(RINGS))
PLANTED = ("lambertian", "ward")
CONFIG = FitConfig.from_dict(
    {
        "cluster": {"count": 2},
        "sample": {"per_cluster": 3},
        "search": {
            "models": list(PLANTED),
            "max_lobes": 3,
            "restarts": 2,
            "bank_normals": 32,
            "exchanges": 1,
        },
        "device": "cpu",
    }
)


def planted_lobes() -> SPMM:
    return planted_model(lobes_per_texel=2, lobes_per_cluster=3, rings=RINGS, names=PLANTED, seed=5)


def likeness(truth: LobeBatch, lobes: LobeBatch) -> Tensor:
    """The correlation of every true lobe with the most similar other one, over all pairs."""
    directions = ring_directions(RINGS)
    with torch.no_grad():
        first, second = (x.eval_grid(directions, directions) for x in (truth, lobes))
    first, second = (x / x.norm(dim=1, keepdim=True) for x in (first, second))
    return (first @ second.T).amax(1)


def planted(damage: Tensor | None = None) -> BTF:
    """8 x 8 texels of known lobes; pairs of `damage [V, L]` hold something else."""
    btf = tabulated(planted_lobes())
    if damage is None:
        return btf
    other = torch.where(damage.flatten()[:, None], 0.0, btf.texels())
    return texel_btf(other, btf.light, height=btf.height)


def scattered(share: float) -> Tensor:
    """Some pairs `[V, L]`, of every view and light."""
    return torch.rand(COUNT, COUNT, generator=torch.Generator().manual_seed(2)) < share


@pytest.fixture(scope="module")
def unweighted() -> FitResult:
    return fit(planted(), CONFIG, render=False)


@pytest.fixture(scope="module")
def masked() -> FitResult:
    missing = scattered(0.15)
    return fit(replace(planted(missing), missing=missing), CONFIG, render=False)


def test_masked_pairs_do_not_hide_the_planted_lobes(
    unweighted: FitResult, masked: FitResult
) -> None:
    assert unweighted.report["snr_db"]["without_residual"] > 35.0
    assert masked.report["snr_db"]["without_residual"] > 35.0
    truth = planted_lobes().dictionary
    for lobes in (unweighted.model.dictionary, masked.model.dictionary):
        assert float(likeness(truth, lobes).min()) > 0.99
    assert masked.report["direction_pairs"] == COUNT**2 - int(scattered(0.15).sum())


def test_the_model_is_right_where_nothing_was_measured(masked: FitResult) -> None:
    truth, model = planted(), masked.model
    wrong, energy = 0.0, 0.0
    for view, light in torch.nonzero(scattered(0.15))[::16].tolist():
        original = truth.picture(view, light)
        with torch.no_grad():
            picture = model.picture(model.light[light], model.view[view])
        wrong += float((picture - original).square().sum())
        energy += float(original.square().sum())
    assert wrong < 1e-3 * energy


def test_pairs_without_weight_do_not_count() -> None:
    damage = scattered(0.15)
    btf = planted(damage)
    weights = Weights.build(btf, (~damage).float())
    report = fit(btf, CONFIG, weights=weights, render=False).report
    assert report["weighted_snr_db"]["without_residual"] > 35.0
    assert report["snr_db"]["without_residual"] < 20.0


def rough() -> BTF:
    """The planted values times noise."""
    generator = torch.Generator().manual_seed(3)
    btf = planted()
    noise = 1.0 + 0.3 * torch.rand(btf.texels().shape, generator=generator)
    return texel_btf(btf.texels() * noise, btf.light, height=btf.height)


def test_even_weights_change_nothing_but_rounding() -> None:
    btf = rough()
    even = Weights.build(btf, torch.ones(COUNT, COUNT), torch.ones(8, 8))
    plain, result = fit(btf, CONFIG, render=False), fit(btf, CONFIG, weights=even, render=False)
    assert torch.equal(result.info["labels"], plain.info["labels"])
    for name, value in plain.report["snr_db"].items():
        # Rounding may lead the search to other lobes, but not to worse ones.
        limit = 1e-3 if name == "cluster_mean" else 0.5
        assert result.report["snr_db"][name] == pytest.approx(value, abs=limit)
        assert result.report["weighted_snr_db"][name] == pytest.approx(value, abs=limit)


def test_the_report_has_both_errors(unweighted: FitResult, masked: FitResult) -> None:
    for report in (unweighted.report, masked.report):
        check_report(report)
    assert unweighted.report["weighted_snr_db"] is None
    names = {"without_residual", "with_residual", "cluster_mean"}
    assert set(masked.report["weighted_snr_db"]) == names


@pytest.mark.parametrize("error", ["cube-root", "log"])
def test_compressive_errors_move_accuracy_to_dark_pairs(error: str) -> None:
    btf = rough()
    alone = ["residual.rank=0", "residual.clusters=true", "relief.mode=off"]
    config = CONFIG.override(["search.exchanges=0", "select.max_lobes=1", *alone])
    plain = fit(btf, config, render=False)
    result = fit(btf, config.override([f"weights.error={error}"]), render=False)
    assert result.report["snr_db"]["with_residual"] <= plain.report["snr_db"]["with_residual"]
    assert dark_error(btf, result) < dark_error(btf, plain)


def dark_error(btf: BTF, result: FitResult) -> float:
    """Squared error of cube roots over all pairs."""
    model, total = result.model, 0.0
    for view in range(0, COUNT, 5):
        for light in range(0, COUNT, 3):
            with torch.no_grad():
                shown = model.picture(model.light[light], model.view[view]).clamp(min=0.0)
            original = btf.picture(view, light)
            total += float((shown ** (1 / 3) - original ** (1 / 3)).square().sum())
    return total


def test_the_stagewise_search_is_weighted_too() -> None:
    damage = scattered(0.15)
    config = CONFIG.override(
        [
            "search.method=stagewise",
            "select.method=stagewise",
            "sample.per_cluster=1",
            "search.pairs=128",
            "search.adam_steps=4",
            "search.lbfgs_steps=4",
            "stagewise.eta=0.1",
            "stagewise.max_steps=12",
        ]
    )
    weights = Weights.build(planted(damage), (~damage).float())
    damaged = fit(planted(damage), config, weights=weights, render=False).report["weighted_snr_db"]
    whole = fit(planted(), config, render=False).report["snr_db"]
    assert damaged["without_residual"] > whole["without_residual"] - 2.0
