"""MUSIC: lobes that lie in the subspace of the signals, exact where few lobes make all signals.

N signals that are sums of r < N lobes span r dimensions, and each of those lobes lies in that
signal subspace. Each lobe is therefore a zero of its distance from the subspace [Sch86] and can be
sought alone, where a search for whole mixtures gets stuck in local minima. Measured materials span
every dimension: for them the search ends at once and finds nothing.

References:
    [Sch86] Ralph O. Schmidt, Multiple Emitter Location and Signal Parameter Estimation, IEEE
        Transactions on Antennas and Propagation 34(3), 276-280, 1986.
    [ML99] John C. Mosher, Richard M. Leahy, Source Localization Using Recursively Applied and
        Projected (RAP) MUSIC, IEEE Transactions on Signal Processing 47(2), 332-340, 1999.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...geometry.directions import half_vectors
from ...lobes.batch import COORDINATES, Feasible, LobeBatch
from ...lobes.grid import SAME_LOBE, DirectionGrid, distinct
from ...solvers.varpro import DAMPING_START, damped_step, next_damping
from .bank import PEAK_SHAPES, Bank, bank_at

# Signals span r dimensions if the others hold at most this fraction of the energy (50 dB), if the
# energy falls by at least this factor behind the last one, and with this many signals a dimension.
MOST_REST, LEAST_DROP, LEAST_SIGNALS = 1e-5, 30.0, 2
# Squared distance from the subspace under which a lobe of unit norm lies in it (50 dB).
INSIDE = 1e-5
# Squared distance from the subspace that is rounding.
EXACT = 1e-10
# For each model: bank lobes that are compared, starts among them, largest correlation of starts.
CANDIDATES, STARTS, START_CORRELATION = 400, 48, 0.97
STEPS, ROUNDS = 24, 4
# Pairs of most energy at which narrow lobes are tried.
PEAKS = 64
# Least squared norm that is left of a lobe without those found before: less is rounding.
LEAST_NORM = 1e-4


@dataclass(frozen=True)
class MusicSearch:
    """The search for lobes in a signal subspace [Sch86].

    Attributes:
        grid, bank, feasible: of the stage.
        space: orthonormal rows that span the subspace, `[r, D]`.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    space: Tensor

    def run(self) -> LobeBatch:
        """Lobes that lie in the subspace, no two alike."""
        model = self.space.new_zeros(0, dtype=torch.long)
        coordinates = self.space.new_zeros(0, COORDINATES)
        for _ in range(ROUNDS if len(self.space) else 0):
            found = len(model)
            basis = torch.linalg.qr(self._atoms(model, coordinates).T).Q.T  # [found, D]
            start = self._starts(basis)
            trial_model = self.bank.lobes.model[start]
            trial, distance = self._descend(trial_model, self.bank.coordinates[start], basis)
            inside = torch.nonzero(distance < INSIDE).squeeze(1)
            inside = inside[distance[inside].argsort()]
            model = torch.cat((model, trial_model[inside]))
            coordinates = torch.cat((coordinates, trial[inside]))
            kept = distinct(self._atoms(model, coordinates), SAME_LOBE)
            model, coordinates = model[kept], coordinates[kept]
            if len(model) == found or len(model) >= len(self.space):
                break
        return self.grid.decode(model, coordinates)

    def _atoms(self, model: Tensor, coordinates: Tensor) -> Tensor:
        """Values of lobes, of unit norm, `[J, D]`."""
        values = self.grid.eval(self.grid.decode(model, coordinates))
        return values / values.norm(dim=1, keepdim=True)

    def _starts(self, basis: Tensor) -> Tensor:
        """Indices `[N]` of the bank lobes nearest to the subspace without `basis [J, D]`."""
        along = (self.bank.atoms @ basis.T).square().sum(1)
        inside = (self.bank.atoms @ self.space.T).square().sum(1) - along
        score = (inside / (1.0 - along).clamp(min=LEAST_NORM)).clamp(max=1.0)
        chosen = []
        for _, own in self.bank.by_model:
            best = own[score[own].argsort(descending=True)[:CANDIDATES]]
            kept = distinct(self.bank.atoms[best], START_CORRELATION)[:STARTS]
            chosen.append(best[kept])
        return torch.cat(chosen)

    def _descend(self, model: Tensor, start: Tensor, basis: Tensor) -> tuple[Tensor, Tensor]:
        """Coordinates `[J, P]` and squared distances `[J]` at the nearest minima.

        Every lobe is projected on the complement of the lobes found before, `basis`, which would
        attract all others [ML99].
        """
        coordinates = start.clone()
        distance = self._distance(model, start, basis)
        damping = torch.full_like(distance, DAMPING_START)
        for _ in range(STEPS):
            rows = torch.nonzero(distance > EXACT).squeeze(1)
            if not len(rows):
                break
            own = model[rows]
            step = damped_step(*self._derivatives(own, coordinates[rows], basis), damping[rows])
            trial = self.feasible.project(own, coordinates[rows] + step.to(start.dtype))
            there = self._distance(own, trial, basis)
            better = there < distance[rows]
            coordinates[rows] = torch.where(better[:, None], trial, coordinates[rows])
            distance[rows] = torch.where(better, there, distance[rows])
            damping[rows] = next_damping(damping[rows], better)
        return coordinates, distance

    def _distance(self, model: Tensor, coordinates: Tensor, basis: Tensor) -> Tensor:
        """Squared distances `[J]` of projected lobes of unit norm from the subspace."""
        atoms = _without(self._atoms(model, coordinates), basis)
        rest = atoms.square().sum(1, dtype=torch.float64).clamp(min=LEAST_NORM)
        outside = _without(atoms, self.space)
        return outside.square().sum(1, dtype=torch.float64) / rest

    def _derivatives(
        self, model: Tensor, coordinates: Tensor, basis: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Hessian (Gauss-Newton) `[J, P, P]` and gradient `[J, P]` of half the squared distance."""
        parts = self.grid.jacobian(model[:, None], coordinates[:, None])
        rho, jacobian = (_without(part[:, 0], basis) for part in parts)  # [J, D], [J, P, D]
        norm = rho.norm(dim=1)
        atoms, jacobian = rho / norm[:, None], jacobian / norm[:, None, None]
        jacobian = jacobian - (jacobian @ atoms[..., None]) * atoms[:, None]  # at unit norm
        inner = jacobian @ self.space.T  # [J, P, r]
        hessian = jacobian @ jacobian.transpose(1, 2) - inner @ inner.transpose(1, 2)
        gradient = jacobian @ _without(atoms, self.space)[..., None]
        return hessian.double(), gradient.squeeze(-1).double()


def _without(values: Tensor, basis: Tensor) -> Tensor:
    """Rows `[..., D]` projected on the complement of orthonormal rows `basis [J, D]`."""
    return values - (values @ basis.T) @ basis


def signal_subspace(signals: Tensor) -> Tensor:
    """Orthonormal rows `[r, D]` that span signals `[N, D]`; none where r is not far under N."""
    norm = signals.norm(dim=1)
    signals = signals[norm > 0.0] / norm[norm > 0.0, None]
    gram = signals.double() @ signals.double().T
    energy, vectors = (part.flip(-1) for part in torch.linalg.eigh(gram))  # largest first
    energy = energy.clamp(min=torch.finfo(signals.dtype).eps ** 2 * len(signals))
    most = len(energy) // LEAST_SIGNALS
    rest = 1.0 - energy.cumsum(0)[:most] / energy.sum()  # behind 1, 2, ... dimensions
    drop = energy[:most] / energy[1 : most + 1]
    drop = torch.where(rest <= MOST_REST, drop, 0.0)
    if not len(drop) or float(drop.max()) < LEAST_DROP:
        return signals[:0]
    rank = int(drop.argmax()) + 1
    rows = (vectors[:, :rank] / energy[:rank].sqrt()).T @ signals.double()
    return rows.to(signals.dtype)


def music_lobes(signals: Tensor, grid: DirectionGrid, bank: Bank, feasible: Feasible) -> LobeBatch:
    """Lobes in the subspace of signals `[N, D]` [Sch86]; none where that is not a small one."""
    space = signal_subspace(signals)
    if len(space):
        bank = _with_peaks(space, grid, bank, feasible)
    return MusicSearch(grid, bank, feasible, space).run()


def _with_peaks(space: Tensor, grid: DirectionGrid, bank: Bank, feasible: Feasible) -> Bank:
    """A bank with narrow lobes whose normals are the half vectors of the pairs of most leverage.

    A lobe that few pairs see peaks between the normals of any fixed bank.
    """
    used = {MODEL_NAMES[index] for index, _ in bank.by_model}
    shapes = {name: rows for name, rows in PEAK_SHAPES.items() if name in used}
    if not shapes:
        return bank
    leverage = space.square().sum(0)  # [D]
    half = half_vectors(*grid.at(leverage.topk(min(PEAKS, len(leverage))).indices))
    return bank.joined(bank_at(grid, shapes, half, feasible))
