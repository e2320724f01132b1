"""Sparse weights by scikit-learn's Lasso with positive weights, in Gram form.

Signals have norm 1, so that one regularization suits all. scikit-learn runs coordinate descent on
one channel of one texel after another.
"""

from __future__ import annotations

import warnings
from typing import Any, cast

import torch
from torch import Tensor

from ..protocol import measure
from .problem import SELECTION, Peer, Problem, Row, lobes_of_weights, row, snr_of_weights

# Regularization relative to the norm of the signal, as `stagewise.lambda_min`.
LAMBDAS = (0.1, 0.03, 0.01)
ITERATIONS = 2000


def run(problem: Problem) -> list[Row]:
    """Solves some texels with each regularization."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import Lasso

    values = problem.values[problem.some_texels(problem.scope.dictionary_texels)].cpu()
    atoms = problem.atoms.cpu()
    count, pairs, channels = values.shape
    signals = values.transpose(1, 2).reshape(-1, pairs).double()  # [n C, D]
    norm = signals.norm(dim=1, keepdim=True).clamp(min=torch.finfo(torch.float32).tiny)
    columns = atoms.double().T.contiguous().numpy()  # [D, J]
    targets = (signals / norm).T.contiguous().numpy()  # [D, n C]

    def solve(strength: float) -> Tensor:
        # A type checker knows only the bool of this argument's default.
        gram = cast(Any, columns.T @ columns)  # [J, J]
        # scikit-learn divides the squared error by 2 D, so lambda is divided by D, too.
        lasso = Lasso(
            strength / pairs,
            fit_intercept=False,
            precompute=gram,
            positive=True,
            max_iter=ITERATIONS,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            weights = torch.from_numpy(lasso.fit(columns, targets).coef_)
        return (weights * norm).view(count, channels, -1)

    rows = []
    for strength in LAMBDAS:
        weights, timing = measure(
            lambda strength=strength: solve(strength),
            problem.protocol,
            problem.device,
            warm_up=not rows,
        )
        snr = snr_of_weights(values, weights, atoms)
        lobes = lobes_of_weights(weights)
        name = f"scikit-learn Lasso, lambda {strength:g}"
        rows.append(row(name, SELECTION, count, timing, snr, lobes=lobes))
    return rows


PEER = Peer("scikit-learn lasso", "sparse weights of a given dictionary by Lasso", run, "sklearn")
