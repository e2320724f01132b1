"""Weights of all lobes of the dictionary by a loop of `scipy.optimize.nnls`, texel by texel.

Exact least squares without sparsity: the least error that the dictionary allows, and the most
lobes. A QR decomposition of the atoms comes first, so that no problem reads all direction pairs.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import nnls
from torch import Tensor

from ..protocol import measure
from .problem import SELECTION, Peer, Problem, Row, lobes_of_weights, row, snr_of_weights


def run(problem: Problem) -> list[Row]:
    """Solves some texels, one channel after another."""
    values = problem.values[problem.some_texels(problem.scope.dictionary_texels)].cpu()
    atoms = problem.atoms.cpu()

    def work() -> Tensor:
        basis, triangle = np.linalg.qr(atoms.double().numpy().T)  # [D, J], [J, J]
        targets = values.transpose(1, 2).double().numpy() @ basis  # [n, C, J]
        weights = [[nnls(triangle, target)[0] for target in texel] for texel in targets]
        return torch.from_numpy(np.array(weights))  # [n, C, J]

    weights, timing = measure(work, problem.protocol, problem.device, warm_up=False)
    return [
        row(
            "scipy.optimize.nnls, texel by texel",
            SELECTION,
            len(values),
            timing,
            snr_of_weights(values, weights, atoms),
            lobes=lobes_of_weights(weights),
            note="every lobe may be used: the least error of this dictionary",
        )
    ]


PEER = Peer("scipy nnls", "weights of a given dictionary by a loop of non-negative fits", run)
