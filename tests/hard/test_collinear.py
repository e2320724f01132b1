"""Duplicated and nearly collinear lobes: Gram matrices of condition 10^8 and beyond."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import nnls
from torch import Tensor

from spmm_torch.solvers.foba import select_foba
from spmm_torch.solvers.nnls import nnls_gram
from tests.hard.cases import COARSE, TWINS
from tests.planted.lobes import lobe_batch

PAIRS, TEXELS = 400, 5


def collinear(distance: float) -> Tensor:
    """Six atoms `[6, D]` of unit norm, float64, three of them `distance` apart and one doubled."""
    generator = torch.Generator().manual_seed(0)
    wide = torch.rand(3, PAIRS, generator=generator, dtype=torch.float64)
    wide = wide / wide.norm(dim=1, keepdim=True)
    other = torch.rand(2, PAIRS, generator=generator, dtype=torch.float64)
    near = wide[0] + distance * other / other.norm(dim=1, keepdim=True)
    atoms = torch.cat((wide, near, wide[1:2]))
    return atoms / atoms.norm(dim=1, keepdim=True)


def signals(atoms: Tensor) -> Tensor:
    """Values `[T, D]` of the atoms and a little noise."""
    generator = torch.Generator().manual_seed(1)
    weights = torch.rand(TEXELS, len(atoms), generator=generator, dtype=torch.float64)
    noise = torch.randn(TEXELS, PAIRS, generator=generator, dtype=torch.float64)
    return weights @ atoms + 1e-3 * noise


def error(y: Tensor, atoms: Tensor, weights: Tensor) -> Tensor:
    return (y - weights.double() @ atoms).square().sum(1)


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 0.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_weights_are_as_good_as_the_best(distance: float, dtype: torch.dtype) -> None:
    """SciPy works on the atoms themselves, whose condition is the root of the Gram's."""
    atoms = collinear(distance)
    y = signals(atoms)
    stored = atoms.to(dtype)
    gram, rhs = stored @ stored.T, y.to(dtype) @ stored.T
    found = nnls_gram(gram.double(), rhs.double()).weights
    best = [nnls(atoms.T.numpy(), row.numpy())[1] ** 2 for row in y]
    assert bool(found.isfinite().all()) and float(found.min()) >= 0.0
    slack = 1.01 if dtype == torch.float64 else 1.05
    assert (error(y, atoms, found) <= slack * torch.tensor(best)).all()


def test_selection_takes_one_of_two_that_are_alike() -> None:
    atoms = collinear(1e-4)
    condition = np.linalg.cond((atoms[[0, 3]] @ atoms[[0, 3]].T).numpy())
    assert condition > 1e8
    stored = atoms.float()
    y = (stored[:1] + 0.5 * stored[2:3]).expand(TEXELS, -1)
    chosen = select_foba(
        stored @ stored.T,
        (y @ stored.T)[..., None],
        y.square().sum(1, dtype=torch.float64),
        max_lobes=6,
        min_gain=0.001,
    )
    assert (chosen.index >= 0).sum(1).tolist() == [2] * TEXELS
    dense = torch.zeros(TEXELS, 6).scatter_add_(
        1, chosen.index.clamp(min=0), chosen.weights[..., 0]
    )
    assert (error(y.double(), atoms, dense) < 1e-6 * y.double().square().sum(1)).all()


def test_twins_are_as_alike_as_they_say() -> None:
    rho = lobe_batch(*TWINS.lobes, dtype=torch.float64).eval_grid(COARSE.double(), COARSE.double())
    rho = rho / rho.norm(dim=1, keepdim=True)
    assert np.linalg.cond((rho @ rho.T).numpy()) > 1e8
