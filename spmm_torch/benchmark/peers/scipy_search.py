"""The search of the paper as a loop with SciPy: one texel, one model and one start at a time.

L-BFGS-B fits each lobe to the residual of the lobes before it, from random starts of every model
and with exact gradients; NNLS then fits all weights again. This is a strong form of the paper's
loop, which takes steps of eta in one channel at a time. It runs in a single thread.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import minimize, nnls
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...config.shipped import shipped
from ...geometry.directions import MAX_DISK_RADIUS
from ...lobes.batch import COORDINATES, Feasible
from ..protocol import measure
from ..variants import DEFAULT
from .problem import SEARCH, Peer, Problem, Row, row, snr_of

STARTS = 2  # of each model
ITERATIONS = 40
# Half of the side of the square inside the disk of all normals.
SIDE = MAX_DISK_RADIUS / np.sqrt(2.0)


class TexelSearch:
    """The search on one texel.

    Args:
        problem: with the direction pairs.
        signal: values `[D, C]`.
        random: of the starts.
    """

    def __init__(self, problem: Problem, signal: Tensor, random: np.random.Generator) -> None:
        self.config = shipped(DEFAULT, problem.scope.overrides).search
        self.grid, self.random = problem.grid, random
        self.signal = signal.double().cpu().numpy()
        bounds = Feasible.build(self.config.min_width * self.grid.spacing)
        self.low, self.high = bounds.low.double().numpy(), bounds.high.double().numpy()
        self.atoms = np.empty((len(self.signal), 0))

    def run(self) -> np.ndarray:
        """The fitted values `[D, C]`."""
        fitted = np.zeros_like(self.signal)
        for _ in range(self.config.max_lobes):
            best = self._best_lobe(self.signal - fitted)
            self.atoms = np.column_stack((self.atoms, best))
            weights = [nnls(self.atoms, column)[0] for column in self.signal.T]
            fitted = self.atoms @ np.stack(weights, axis=1)
        return fitted

    def _best_lobe(self, error: np.ndarray) -> np.ndarray:
        """Values `[D]` of the lobe that removes most of an error `[D, C]`."""
        trials = [
            self._climb(MODEL_NAMES.index(name), error)
            for name in self.config.models
            for _ in range(STARTS)
        ]
        return max(trials, key=lambda trial: trial[0])[1]

    def _climb(self, model: int, error: np.ndarray) -> tuple[float, np.ndarray]:
        low = np.concatenate(([-SIDE, -SIDE, -np.pi], self.low[model]))
        high = np.concatenate(([SIDE, SIDE, np.pi], self.high[model]))
        found = minimize(
            self._loss,
            self.random.uniform(low, high),
            (model, error),
            method="L-BFGS-B",
            jac=True,
            bounds=np.stack((low, high), axis=1),
            options={"maxiter": ITERATIONS},
        )
        rho, _ = self._lobe(model, found.x)
        return -float(found.fun), rho

    def _lobe(self, model: int, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values `[D]` and Jacobian `[P, D]`."""
        where = torch.from_numpy(place).to(self.grid.light)[None, None]  # [1, 1, P]
        parts = self.grid.jacobian(torch.tensor([[model]]), where)
        rho, jacobian = (part.double().cpu().numpy() for part in parts)
        return rho.reshape(-1), jacobian.reshape(COORDINATES, -1)

    def _loss(self, place: np.ndarray, model: int, error: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the squared error that a lobe removes, and its gradient `[P]` [WDR11 Eq. 5]."""
        rho, jacobian = self._lobe(model, place)
        energy = rho @ rho
        if energy <= 0.0:  # under the horizon of every pair
            return 0.0, np.zeros(COORDINATES)
        along = np.maximum(rho @ error, 0.0)  # [C]
        gain = float(along @ along / energy)
        gradient = 2.0 * (jacobian @ error @ along - gain * (jacobian @ rho)) / energy
        return -gain, -gradient


def run(problem: Problem) -> list[Row]:
    """Searches a few texels, one after another."""
    texels = problem.some_texels(problem.scope.search_texels)
    values = problem.btf.texels(texels)

    @torch.no_grad()
    def work() -> Tensor:
        random = np.random.default_rng(0)
        fitted = [TexelSearch(problem, signal, random).run() for signal in values]
        return torch.from_numpy(np.stack(fitted))

    fitted, timing = measure(work, problem.protocol, problem.device, warm_up=False)
    config = shipped(DEFAULT, problem.scope.overrides).search
    return [
        row(
            "SciPy L-BFGS-B, texel by texel",
            SEARCH,
            len(texels),
            timing,
            snr_of(values.double(), fitted),
            lobes=float(config.max_lobes),
            note=f"{len(config.models)} models x {STARTS} starts for each lobe",
        )
    ]


PEER = Peer("scipy search", "the search for lobes as a loop with SciPy, on a few texels", run)
