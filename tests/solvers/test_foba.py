"""Fully corrective selection: planted supports, bookkeeping, comparison with plain greedy."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.solvers.foba import Selection, select_foba
from spmm_torch.solvers.nnls import kkt_violation, nnls_gram
from spmm_torch.solvers.status import Status


def make_problem(
    texels: int = 50, atoms: int = 20, lobes: int = 3, noise: float = 0.0, seed: int = 0
) -> tuple[Tensor, Tensor, Tensor]:
    """Positive atoms `[D, J]`, data `[T, D, C]` and the planted weights `[T, J, C]`."""
    generator = torch.Generator().manual_seed(seed)
    design = torch.rand(120, atoms, generator=generator, dtype=torch.float64) ** 3
    order = torch.rand(texels, atoms, generator=generator).argsort(1)
    active = (order < lobes)[..., None]
    weights = torch.rand(texels, atoms, 3, generator=generator, dtype=torch.float64) + 0.2
    weights = weights * active
    data = torch.einsum("dj,tjc->tdc", design, weights)
    disturbance = torch.randn(data.shape, generator=generator, dtype=torch.float64)
    return design, data + noise * disturbance, weights


def select(design: Tensor, data: Tensor, max_lobes: int = 6, min_gain: float = 1e-3) -> Selection:
    return select_foba(
        design.T @ design,
        torch.einsum("dj,tdc->tjc", design, data),
        data.square().sum((1, 2)),
        max_lobes=max_lobes,
        min_gain=min_gain,
    )


def densify(found: Selection, atoms: int) -> Tensor:
    """Weights `[T, J, C]`."""
    texels, _, channels = found.weights.shape
    dense = found.weights.new_zeros(texels, atoms + 1, channels)
    spot = torch.where(found.index < 0, atoms, found.index)
    return dense.scatter_(1, spot[..., None].expand_as(found.weights), found.weights)[:, :atoms]


def test_planted_support_is_found() -> None:
    design, data, planted = make_problem()
    found = select(design, data)
    torch.testing.assert_close(densify(found, 20), planted, rtol=0, atol=1e-4)
    assert ((found.index >= 0).sum(1) == 3).all()


def test_planted_support_is_found_under_noise_in_float32() -> None:
    design, data, planted = make_problem(noise=0.01)
    found = select(design.float(), data.float(), min_gain=0.05)
    assert found.weights.dtype == found.error.dtype == torch.float32
    same = ((densify(found, 20) > 0) == (planted > 0)).all(dim=(1, 2))
    assert same.double().mean() > 0.9


@pytest.mark.parametrize("max_lobes", [1, 3, 6])
def test_error_is_the_direct_one_and_weights_are_optimal(max_lobes: int) -> None:
    design, data, _ = make_problem(lobes=8, noise=0.3)
    found = select(design, data, max_lobes=max_lobes)
    dense = densify(found, 20)
    direct = (data - torch.einsum("dj,tjc->tdc", design, dense)).square().sum(1)
    torch.testing.assert_close(found.error, direct.sum(1), rtol=1e-9, atol=1e-9)
    gram = design.T @ design
    rhs = torch.einsum("dj,tdc->tcj", design, data)
    allowed = (dense > 0).any(-1)[:, None].expand_as(rhs)
    assert kkt_violation(gram, rhs, dense.transpose(1, 2), allowed=allowed).max() < 1e-8
    assert ((found.index >= 0).sum(1) <= max_lobes).all()


def test_padding_comes_last_and_atoms_are_distinct() -> None:
    design, data, _ = make_problem(lobes=8, noise=0.3)
    found = select(design, data)
    chosen = found.index >= 0
    assert (chosen[:, :-1] | ~chosen[:, 1:]).all()
    assert (found.weights[~chosen] == 0).all()
    assert (found.weights[chosen] > 0).any(-1).all()
    for row in found.index:
        atoms = row[row >= 0].tolist()
        assert len(atoms) == len(set(atoms))


def test_batched_equals_looped() -> None:
    design, data, _ = make_problem(texels=20, lobes=8, noise=0.3)
    whole = select(design, data)
    for i in range(20):
        alone = select(design, data[i, None])
        assert torch.equal(alone.index[0], whole.index[i])
        torch.testing.assert_close(alone.weights[0], whole.weights[i])


def test_never_worse_than_plain_greedy() -> None:
    design, data, _ = make_problem(lobes=8, noise=0.3)
    found = select(design, data, max_lobes=5, min_gain=0.0)
    gram = design.T @ design
    rhs = torch.einsum("dj,tdc->tcj", design, data)
    allowed = torch.zeros(50, 20, dtype=torch.bool)
    weights = torch.zeros_like(rhs)
    for _ in range(5):
        score = ((rhs - weights @ gram).clamp_min(0) ** 2).sum(1) / gram.diagonal()
        allowed |= torch.nn.functional.one_hot(score.masked_fill(allowed, -1).argmax(1), 20).bool()
        weights = nnls_gram(gram, rhs, allowed=allowed[:, None]).weights
    residual = data - torch.einsum("dj,tcj->tdc", design, weights)
    greedy = residual.square().sum((1, 2))
    # Texels stop early only where an atom gives less than the floor of 1e-6 of the energy.
    assert (found.error <= greedy + 6e-6 * data.square().sum((1, 2))).all()


def test_backward_elimination_drops_the_misleading_first_atom() -> None:
    first, second, third = torch.eye(3, dtype=torch.float64)
    between = (first + second + 0.5 * third) / 1.5
    design = torch.stack([first, second, between], dim=1)
    data = (first + second)[None, :, None]
    found = select(design, data, max_lobes=3, min_gain=0.01)
    assert sorted(found.index[0].tolist()) == [-1, 0, 1]
    assert found.error.item() < 1e-9


def test_gain_limit_holds_for_every_kept_lobe() -> None:
    design, data, _ = make_problem(lobes=8, noise=0.3)
    found = select(design, data, min_gain=0.1)
    rhs = torch.einsum("dj,tdc->tcj", design, data)
    dense = densify(found, 20).transpose(1, 2)  # [T, C, J]
    for slot in range(found.index.shape[1]):
        texel = (found.index[:, slot] >= 0).nonzero()[:, 0]
        allowed = (dense[texel] > 0).any(1)
        allowed[torch.arange(len(texel)), found.index[texel, slot]] = False
        without = nnls_gram(design.T @ design, rhs[texel], allowed=allowed[:, None]).weights
        residual = data[texel] - torch.einsum("dj,tcj->tdc", design, without)
        error = residual.square().sum((1, 2))
        assert (error - found.error[texel] > 0.1 * error * (1 - 1e-9)).all()


def test_degenerate_problems() -> None:
    design, data, _ = make_problem(texels=3)
    nothing = select(design, torch.zeros_like(data))
    assert (nothing.index == -1).all() and (nothing.error == 0).all()
    assert (select(design, -data).index == -1).all()
    doubled = torch.cat([design, design, torch.zeros_like(design[:, :1])], dim=1)
    torch.testing.assert_close(
        select(doubled, data).error, select(design, data).error, rtol=0, atol=1e-9
    )
    assert select(design[:, :1], data).index.shape == (3, 6)
    assert select(design, data[:0]).index.shape == (0, 6)


def test_texels_end_converged_or_at_the_limit_of_atoms() -> None:
    design, data, _ = make_problem()
    assert (select(design, data).status == Status.CONVERGED).all()
    assert (select(design, data, max_lobes=2).status == Status.LIMIT).all()
    data[7] = 2.0 * design[:, :1]  # one atom says it all
    few = select(design, data, max_lobes=2)
    assert few.status.tolist() == [
        Status.CONVERGED if texel == 7 else Status.LIMIT for texel in range(50)
    ]
    assert few.nnls_status.shape == (50, 3)
    assert (few.nnls_status == Status.CONVERGED).all()


def test_no_room_is_a_limit_and_no_atoms_are_none() -> None:
    design, data, _ = make_problem(texels=3)
    assert (select(design, data, max_lobes=0).status == Status.LIMIT).all()
    assert (select(design[:, :0], data, max_lobes=0).status == Status.CONVERGED).all()


def test_texels_that_took_every_atom_have_converged() -> None:
    orthogonal = torch.eye(4, dtype=torch.float64)
    everything = select_foba(
        orthogonal, torch.ones(2, 4, 1), 4.0 * torch.ones(2), max_lobes=4, min_gain=0.0
    )
    assert (everything.index >= 0).all()
    assert (everything.status == Status.CONVERGED).all()


def test_texels_whose_values_are_not_finite_are_told_and_leave_the_others_alone() -> None:
    design, data, _ = make_problem(texels=6)
    gram, energy = design.T @ design, data.square().sum((1, 2))
    correlation = torch.einsum("dj,tdc->tjc", design, data)
    clean = select_foba(gram, correlation, energy, max_lobes=6, min_gain=1e-3)
    correlation[1, 4, 0], correlation[2, 5, 1] = torch.nan, torch.inf
    energy[3] = torch.nan
    found = select_foba(gram, correlation, energy, max_lobes=6, min_gain=1e-3)
    bad = torch.tensor([False, True, True, True, False, False])
    assert torch.equal(found.status == Status.NOT_FINITE, bad)
    assert torch.equal(found.status[~bad], clean.status[~bad])
    assert torch.equal(found.weights[~bad], clean.weights[~bad])


def test_refits_tell_how_their_least_squares_ended() -> None:
    """An inner product of -2 makes the Gram indefinite: a refit of both atoms has no minimizer."""
    gram = torch.tensor([[1.0, -2.0], [-2.0, 1.0]], dtype=torch.float64)
    correlation = torch.tensor([[[2.0, 0.1], [0.0, 1.0]]], dtype=torch.float64)  # [1, J, C]
    energy = 100.0 * torch.ones(1)
    one = select_foba(gram, correlation, energy, max_lobes=1, min_gain=0.0)
    assert one.nnls_status.tolist() == [[Status.CONVERGED] * 2]
    both = select_foba(gram, correlation, energy, max_lobes=2, min_gain=0.0)
    assert both.nnls_status.tolist() == [[Status.NO_DESCENT] * 2]
    assert both.weights.isfinite().all() and (both.error < one.error).all()


@pytest.mark.parametrize("max_lobes", [4, None])
def test_an_empty_dictionary_leaves_all_of_the_error(max_lobes: int | None) -> None:
    energy = torch.tensor([2.0, 0.0])
    found = select_foba(
        torch.zeros(0, 0), torch.zeros(2, 0, 3), energy, max_lobes=max_lobes, min_gain=0.01
    )
    assert torch.equal(found.error, energy)
    assert bool((found.index == -1).all()) and not bool(found.weights.any())
    assert found.status.tolist() == [Status.CONVERGED] * 2
