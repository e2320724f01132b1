"""Non-negative least squares against scipy, its optimality conditions, and how problems end."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from torch import Tensor

from spmm_torch.solvers import nnls_unit
from spmm_torch.solvers.nnls import kkt_violation, nnls_gram, nnls_shared_gram
from spmm_torch.solvers.nnls_supports import MOST_ATOMS, nnls_by_supports
from spmm_torch.solvers.status import Status


def make_problem(
    batch: int, rows: int, atoms: int, correlation: float = 0.0, seed: int = 0
) -> tuple[Tensor, Tensor]:
    """Atoms `[B, rows, J]` with the given mutual correlation, and targets `[B, rows]`."""
    generator = torch.Generator().manual_seed(seed)
    own = torch.randn(batch, rows, atoms, generator=generator, dtype=torch.float64)
    common = torch.randn(batch, rows, 1, generator=generator, dtype=torch.float64)
    design = (1 - correlation) ** 0.5 * own + correlation**0.5 * common
    weights = torch.randn(batch, atoms, 1, generator=generator, dtype=torch.float64).clamp_min(0)
    noise = torch.randn(batch, rows, generator=generator, dtype=torch.float64)
    return design, (design @ weights)[..., 0] + noise


def to_gram(design: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    return design.mT @ design, (design.mT @ target[..., None])[..., 0]


def weights_of(
    gram: Tensor, rhs: Tensor, *, allowed: Tensor | None = None, guess: Tensor | None = None
) -> Tensor:
    return nnls_gram(gram, rhs, allowed=allowed, guess=guess).weights


@pytest.fixture(params=["pivoting", "active set only"])
def stage(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "active set only":
        monkeypatch.setattr(nnls_unit, "PIVOT_ROUNDS", 0)


@pytest.mark.usefixtures("stage")
@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.999])
@pytest.mark.parametrize("atoms", [1, 2, 8, 24])
def test_equals_scipy(atoms: int, correlation: float) -> None:
    design, target = make_problem(40, 3 * atoms + 2, atoms, correlation)
    solved = nnls_gram(*to_gram(design, target))
    found = solved.weights
    assert (solved.status == Status.CONVERGED).all()
    pairs = zip(design.numpy(), target.numpy(), strict=True)
    expected = np.stack([nnls(d, y)[0] for d, y in pairs])
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-7 * (1 + expected.max()))


@pytest.mark.usefixtures("stage")
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_rank_deficient_reaches_the_least_error(dtype: torch.dtype) -> None:
    design, target = make_problem(60, 5, 12)
    design = design.abs()
    design[..., 3] = design[..., 2]
    design[..., 5] = 0
    gram, rhs = to_gram(design, target.abs())
    found = weights_of(gram.to(dtype), rhs.to(dtype))
    assert found.dtype == dtype
    assert (found >= 0).all() and (found[:, 5] == 0).all()
    error = (target.abs() - (design @ found.double()[..., None])[..., 0]).norm(dim=-1)
    expected = [nnls(d.numpy(), y.numpy())[1] for d, y in zip(design, target.abs(), strict=True)]
    slack = 1e-7 if dtype == torch.float64 else 2e-3
    np.testing.assert_allclose(error.numpy(), expected, atol=slack)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**16),
    st.integers(1, 10),
    st.integers(1, 12),
    st.sampled_from([0.0, 0.5, 0.99]),
)
def test_optimality_conditions(seed: int, atoms: int, rows: int, correlation: float) -> None:
    gram, rhs = to_gram(*make_problem(16, rows, atoms, correlation, seed))
    found = weights_of(gram, rhs)
    assert (found >= 0).all()
    assert kkt_violation(gram, rhs, found).max() < 1e-6


def test_violation_sees_a_wrong_answer() -> None:
    gram, rhs = to_gram(*make_problem(4, 20, 5))
    found = weights_of(gram, rhs)
    assert kkt_violation(gram, rhs, found).max() < 1e-9
    assert (kkt_violation(gram, rhs, found + 0.1) > 1e-3).all()


def test_batched_equals_looped_and_blocks_change_nothing() -> None:
    gram, rhs = to_gram(*make_problem(50, 12, 6, 0.9))
    whole = weights_of(gram, rhs)
    looped = torch.stack([weights_of(g, b) for g, b in zip(gram, rhs, strict=True)])
    torch.testing.assert_close(whole, looped, rtol=0, atol=1e-10)
    in_blocks = nnls_gram(gram, rhs, block=7 * 36).weights
    torch.testing.assert_close(whole, in_blocks, rtol=0, atol=1e-10)


def test_gram_broadcasts_over_channels() -> None:
    design, _ = make_problem(9, 12, 4)
    gram = design.mT @ design
    rhs = torch.randn(9, 3, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    found = weights_of(gram[:, None], rhs)
    looped = torch.stack([weights_of(gram, rhs[:, c]) for c in range(3)], dim=1)
    torch.testing.assert_close(found, looped)


def test_allowed_equals_the_smaller_problem() -> None:
    gram, rhs = to_gram(*make_problem(20, 15, 6, 0.5))
    allowed = torch.tensor([True, False, True, True, False, True])
    found = weights_of(gram, rhs, allowed=allowed)
    part = weights_of(gram[:, allowed][:, :, allowed], rhs[:, allowed])
    assert (found[:, ~allowed] == 0).all()
    torch.testing.assert_close(found[:, allowed], part, rtol=0, atol=1e-10)
    assert kkt_violation(gram, rhs, found, allowed=allowed.expand(20, 6)).max() < 1e-9


def test_guess_changes_only_the_speed() -> None:
    gram, rhs = to_gram(*make_problem(40, 15, 6, 0.9))
    guess = torch.rand(40, 6, generator=torch.Generator().manual_seed(2)) < 0.5
    torch.testing.assert_close(weights_of(gram, rhs, guess=guess), weights_of(gram, rhs))


def test_degenerate_problems_end() -> None:
    gram, rhs = to_gram(*make_problem(3, 8, 4))
    assert (weights_of(gram, torch.zeros_like(rhs)) == 0).all()
    assert (weights_of(torch.zeros_like(gram), rhs) == 0).all()
    assert (weights_of(gram, -gram.sum(-1)) >= 0).all()
    assert weights_of(gram[:0], rhs[:0]).shape == (0, 4)
    ones = torch.ones(1, 4, 4, dtype=torch.float64)
    same = weights_of(ones, torch.full((1, 4), 3.0, dtype=torch.float64))
    torch.testing.assert_close(same.sum(), torch.tensor(3.0, dtype=torch.float64))


def test_units_of_atoms_and_target_do_not_matter() -> None:
    gram, rhs = to_gram(*make_problem(10, 12, 4))
    unit = torch.tensor([1e-6, 1.0, 1e3, 1e6], dtype=torch.float64)
    scaled = weights_of(gram * unit[:, None] * unit, 1e-5 * rhs * unit)
    torch.testing.assert_close(scaled * unit * 1e5, weights_of(gram, rhs), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_channels_of_one_gram(correlation: float) -> None:
    """One factorization for all channels, where it will do, gives what each alone gives."""
    design, target = make_problem(30, 20, 6, correlation)
    gram, first = to_gram(design, target)
    rhs = torch.stack([first, first.abs(), gram.sum(-1)], dim=1)  # the last one needs no zeros
    allowed = torch.rand(30, 6, generator=torch.Generator().manual_seed(1)) > 0.2
    gram[0, 2], gram[0, :, 2], rhs[0, :, 2] = 0.0, 0.0, 0.0  # an atom that is zero
    solved = nnls_shared_gram(gram, rhs, allowed=allowed)
    found = solved.weights
    expected = weights_of(gram[:, None], rhs, allowed=allowed[:, None])
    torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)
    assert (found == 0).any(-1).any()
    nothing = nnls_shared_gram(gram[:, :0, :0], rhs[..., :0], allowed=allowed[:, :0])
    assert nothing.weights.shape == (30, 3, 0) and nothing.status.shape == (30, 3)


def test_limit_is_told_where_the_passes_did_not_suffice() -> None:
    """The pivoting leaves a few of these to the active set, for which one pass is too few."""
    gram, rhs = to_gram(*make_problem(400, 12, 24, 0.99))
    cut = nnls_gram(gram, rhs, max_iterations=1)
    limit = cut.status == Status.LIMIT
    assert 0 < limit.sum() < len(limit)
    assert (cut.status[~limit] == Status.CONVERGED).all()
    violation = kkt_violation(gram, rhs, cut.weights)
    assert violation[~limit].max() < 1e-9 < 1e-7 < violation[limit].min()
    assert (cut.weights >= 0).all()
    assert (nnls_gram(gram, rhs).status == Status.CONVERGED).all()


def test_no_descent_where_the_gram_is_far_from_semidefinite() -> None:
    """x = (t, t) lowers the second problem without end: there is no minimizer."""
    gram = torch.tensor([[1.0, 0.5], [0.5, 1.0]], dtype=torch.float64).repeat(2, 1, 1)
    gram[1, [0, 1], [1, 0]] = -2.0
    solved = nnls_gram(gram, torch.ones(2, 2, dtype=torch.float64))
    assert solved.status.tolist() == [Status.CONVERGED, Status.NO_DESCENT]
    assert solved.weights.isfinite().all() and (solved.weights >= 0).all()
    channels = torch.tensor([[[1.0, 1.0], [1.0, -1.0]]], dtype=torch.float64).repeat(2, 1, 1)
    shared = nnls_shared_gram(gram, channels, allowed=torch.ones(2, 2, dtype=torch.bool))
    assert (shared.status[0] == Status.CONVERGED).all()
    assert (shared.status[1] == Status.NO_DESCENT).all()


@pytest.mark.usefixtures("stage")
@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_what_is_not_finite_is_told_and_leaves_the_others_alone(value: float) -> None:
    gram, rhs = to_gram(*make_problem(6, 12, 4))
    broken_gram, broken_rhs = gram.clone(), rhs.clone()
    broken_rhs[1, 2] = value
    broken_gram[3, 0, 2] = broken_gram[3, 2, 0] = value
    broken_gram[4, 1, 1] = value
    solved = nnls_gram(broken_gram, broken_rhs)
    bad = torch.tensor([False, True, False, True, True, False])
    assert (solved.status == Status.NOT_FINITE).tolist() == bad.tolist()
    assert (solved.status[~bad] == Status.CONVERGED).all()
    assert torch.equal(solved.weights[~bad], weights_of(gram, rhs)[~bad])


def test_channels_of_one_gram_end_each_on_its_own() -> None:
    gram, rhs = to_gram(*make_problem(5, 12, 4))
    rhs = torch.stack([rhs, gram.sum(-1)], dim=1)  # [5, 2, 4], the second one needs no zeros
    rhs[1, 0, 2], rhs[2, 1, 0] = torch.nan, torch.inf
    gram[3, 0, 0] = torch.nan
    allowed = torch.ones(5, 4, dtype=torch.bool)
    solved = nnls_shared_gram(gram, rhs, allowed=allowed)
    bad = torch.zeros(5, 2, dtype=torch.bool)
    bad[1, 0], bad[2, 1], bad[3] = True, True, True
    assert torch.equal(solved.status == Status.NOT_FINITE, bad)
    assert (solved.status[~bad] == Status.CONVERGED).all()


@pytest.mark.parametrize("atoms", [1, 3, MOST_ATOMS])
def test_all_supports_at_once_find_the_same_minimizer(atoms: int) -> None:
    generator = torch.Generator().manual_seed(atoms)
    basis = torch.randn(40, atoms, 12, generator=generator, dtype=torch.float64)
    signals = torch.randn(40, 3, 12, generator=generator, dtype=torch.float64)
    basis[0, 0] = 0.0  # an atom without effect
    basis[1, -1] = basis[1, 0]  # a repeat
    allowed = torch.rand(40, atoms, generator=generator) < 0.9
    gram, rhs = basis @ basis.transpose(1, 2), signals @ basis.transpose(1, 2)
    weights, status = nnls_by_supports(gram, rhs, allowed)
    assert (status == Status.CONVERGED).all()
    assert (weights >= 0.0).all()
    violation = kkt_violation(gram[:, None], rhs, weights, allowed=allowed[:, None])
    assert float(violation.max()) < 1e-9
