"""Peers do what they say, on mixtures that are known."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
import torch

from spmm_torch.benchmark import peers
from spmm_torch.benchmark.fits import TimedFit
from spmm_torch.benchmark.peers import (
    local_pca,
    own,
    scipy_nnls,
    scipy_search,
    sklearn_lasso,
    vector_quantization,
)
from spmm_torch.benchmark.peers.problem import SELECTION, Problem, Row, snr_of
from spmm_torch.benchmark.scope import Bench
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.lobes.batch import COORDINATES, decode

CPU = torch.device("cpu")
RANDOM = np.random.default_rng(1)
# Errors below this are those of float32.
EXACT = 50.0


def told(row: Row) -> float:
    """The SNR as far as it can be told."""
    return min(row["snr_db"], EXACT)


@pytest.fixture
def rows(problem: Problem) -> dict[str, Row]:
    """All fits of given lobes by their names."""
    solvers = (own, scipy_nnls, sklearn_lasso)
    found = [row for module in solvers for row in module.PEER.run(problem)]
    return {row["name"]: row for row in found if row["group"] == SELECTION}


def test_nnls_leaves_the_least_error(rows: dict[str, Row]) -> None:
    best = rows.pop("scipy.optimize.nnls, texel by texel")
    assert len(rows) == 1 + len(sklearn_lasso.LAMBDAS)
    assert all(told(row) <= told(best) + 1e-3 for row in rows.values())


def test_less_regularization_leaves_less_error(rows: dict[str, Row]) -> None:
    lasso = [rows[f"scikit-learn Lasso, lambda {strength:g}"] for strength in sklearn_lasso.LAMBDAS]
    assert [told(row) for row in lasso] == sorted(told(row) for row in lasso)


def test_lasso_meets_its_own_optimality(problem: Problem) -> None:
    # With one atom y = a the solution is known: 1 - lambda, so the error is lambda of the norm.
    atom = problem.atoms[:1]
    values = 2.0 * atom.T.expand(problem.btf.texel_count, -1, 3)
    problem.__dict__.update(atoms=atom, values=values)  # in the place of what it would compute
    for strength, row in zip(sklearn_lasso.LAMBDAS, sklearn_lasso.PEER.run(problem), strict=True):
        assert row["snr_db"] == pytest.approx(-20.0 * math.log10(strength), abs=0.01)
        assert row["mean_basis_per_texel"] == 1.0


@pytest.mark.parametrize("peer", [local_pca, vector_quantization])
def test_no_more_bytes_than_ours(peer: object, problem: Problem) -> None:
    (row,) = peer.PEER.run(problem)
    assert 0 < row["bytes"] <= problem.byte_budget + problem.btf.texel_count


def test_vector_quantization_with_a_mean_for_each_texel_is_exact(problem: Problem) -> None:
    labels = vector_quantization.clustered(problem.btf, problem.btf.texel_count, CPU)
    assert len(torch.unique(labels)) == problem.btf.texel_count


def test_the_scipy_loop_finds_a_planted_lobe(problem: Problem) -> None:
    coordinates = torch.full((1, COORDINATES), 0.2)
    coordinates[:, 3:] = 0.7
    signal = problem.grid.eval(decode(torch.tensor([MODEL_NAMES.index("ward")]), coordinates))
    search = scipy_search.TexelSearch(problem, signal.T.expand(-1, 3), RANDOM)
    fitted = torch.from_numpy(search.run())  # [D, C]
    assert snr_of(signal.T.expand(-1, 3).double(), fitted) > 20.0


def test_the_slope_of_the_scipy_loop(problem: Problem) -> None:
    search = scipy_search.TexelSearch(problem, problem.values[0], RANDOM)
    model, place = MODEL_NAMES.index("ward"), np.full(COORDINATES, 0.3)
    place[4] = 0.4
    _, slope = search._loss(place, model, search.signal)
    for column in range(5):
        step = 1e-3 * np.eye(COORDINATES)[column]
        ends = [search._loss(place + sign * step, model, search.signal)[0] for sign in (1, -1)]
        assert slope[column] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=0.02, abs=2e-3)


def test_a_missing_package_is_named(
    bench: Bench, default: TimedFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "sklearn" else found(name)
    )
    monkeypatch.setattr(peers, "PEERS", (sklearn_lasso.PEER, scipy_nnls.PEER))
    result = peers.run(bench, default)
    assert {row["peer"] for row in result["rows"]} == {"scipy nnls"}
    (skipped,) = result["skipped"]
    assert skipped["peer"] == "scikit-learn lasso"
    assert skipped["reason"].startswith("sklearn is not installed; pip install")
