"""Non-negative least squares against scipy, and its optimality conditions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from torch import Tensor

from spmm_torch.solvers import nnls as module
from spmm_torch.solvers.nnls import kkt_violation, nnls_channels, nnls_gram


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


@pytest.fixture(params=["pivoting", "active set only"])
def stage(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "active set only":
        monkeypatch.setattr(module, "PIVOT_ROUNDS", 0)


@pytest.mark.usefixtures("stage")
@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.999])
@pytest.mark.parametrize("atoms", [1, 2, 8, 24])
def test_equals_scipy(atoms: int, correlation: float) -> None:
    design, target = make_problem(40, 3 * atoms + 2, atoms, correlation)
    found = nnls_gram(*to_gram(design, target))
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
    found = nnls_gram(gram.to(dtype), rhs.to(dtype))
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
    found = nnls_gram(gram, rhs)
    assert (found >= 0).all()
    assert kkt_violation(gram, rhs, found).max() < 1e-6


def test_violation_sees_a_wrong_answer() -> None:
    gram, rhs = to_gram(*make_problem(4, 20, 5))
    found = nnls_gram(gram, rhs)
    assert kkt_violation(gram, rhs, found).max() < 1e-9
    assert (kkt_violation(gram, rhs, found + 0.1) > 1e-3).all()


def test_batched_equals_looped_and_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    gram, rhs = to_gram(*make_problem(50, 12, 6, 0.9))
    whole = nnls_gram(gram, rhs)
    looped = torch.stack([nnls_gram(g, b) for g, b in zip(gram, rhs, strict=True)])
    torch.testing.assert_close(whole, looped, rtol=0, atol=1e-10)
    monkeypatch.setattr(module, "BLOCK_ELEMENTS", 7 * 36)
    torch.testing.assert_close(whole, nnls_gram(gram, rhs), rtol=0, atol=1e-10)


def test_gram_broadcasts_over_channels() -> None:
    design, _ = make_problem(9, 12, 4)
    gram = design.mT @ design
    rhs = torch.randn(9, 3, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    found = nnls_gram(gram[:, None], rhs)
    looped = torch.stack([nnls_gram(gram, rhs[:, c]) for c in range(3)], dim=1)
    torch.testing.assert_close(found, looped)


def test_allowed_equals_the_smaller_problem() -> None:
    gram, rhs = to_gram(*make_problem(20, 15, 6, 0.5))
    allowed = torch.tensor([True, False, True, True, False, True])
    found = nnls_gram(gram, rhs, allowed=allowed)
    part = nnls_gram(gram[:, allowed][:, :, allowed], rhs[:, allowed])
    assert (found[:, ~allowed] == 0).all()
    torch.testing.assert_close(found[:, allowed], part, rtol=0, atol=1e-10)
    assert kkt_violation(gram, rhs, found, allowed=allowed.expand(20, 6)).max() < 1e-9


def test_guess_changes_only_the_speed() -> None:
    gram, rhs = to_gram(*make_problem(40, 15, 6, 0.9))
    guess = torch.rand(40, 6, generator=torch.Generator().manual_seed(2)) < 0.5
    torch.testing.assert_close(nnls_gram(gram, rhs, guess=guess), nnls_gram(gram, rhs))


def test_degenerate_problems_end() -> None:
    gram, rhs = to_gram(*make_problem(3, 8, 4))
    assert (nnls_gram(gram, torch.zeros_like(rhs)) == 0).all()
    assert (nnls_gram(torch.zeros_like(gram), rhs) == 0).all()
    assert (nnls_gram(gram, -gram.sum(-1)) >= 0).all()
    assert nnls_gram(gram[:0], rhs[:0]).shape == (0, 4)
    ones = torch.ones(1, 4, 4, dtype=torch.float64)
    same = nnls_gram(ones, torch.full((1, 4), 3.0, dtype=torch.float64))
    torch.testing.assert_close(same.sum(), torch.tensor(3.0, dtype=torch.float64))


def test_units_of_atoms_and_target_do_not_matter() -> None:
    gram, rhs = to_gram(*make_problem(10, 12, 4))
    unit = torch.tensor([1e-6, 1.0, 1e3, 1e6], dtype=torch.float64)
    scaled = nnls_gram(gram * unit[:, None] * unit, 1e-5 * rhs * unit)
    torch.testing.assert_close(scaled * unit * 1e5, nnls_gram(gram, rhs), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_channels_of_one_gram(correlation: float) -> None:
    """One factorization for all channels, where it will do, gives what each alone gives."""
    design, target = make_problem(30, 20, 6, correlation)
    gram, first = to_gram(design, target)
    rhs = torch.stack([first, first.abs(), gram.sum(-1)], dim=1)  # the last one needs no zeros
    allowed = torch.rand(30, 6, generator=torch.Generator().manual_seed(1)) > 0.2
    gram[0, 2], gram[0, :, 2], rhs[0, :, 2] = 0.0, 0.0, 0.0  # an atom that is zero
    found = nnls_channels(gram, rhs, allowed=allowed)
    expected = nnls_gram(gram[:, None], rhs, allowed=allowed[:, None])
    torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-9)
    assert (found == 0).any(-1).any()
    nothing = nnls_channels(gram[:, :0, :0], rhs[..., :0], allowed=allowed[:, :0])
    assert nothing.shape == (30, 3, 0)
