"""Lobes by the space that signals span: exact where few lobes made all of them.

N signals that are sums of r < N lobes span r dimensions, and each of those lobes lies in that
space. So every lobe can be sought alone, as a zero of its distance from the space (MUSIC [Schmidt
1986]), where a search for whole mixtures gets stuck between several. Measured materials span
every dimension: for them this search ends at once and finds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...lobes.batch import COORDINATES, Feasible, LobeBatch, decode
from ...lobes.grid import SAME_LOBE, DirectionGrid, distinct
from ...solvers.varpro import DAMPING_START, damped_step, next_damping
from .bank import PEAK_SHAPES, Bank, bank_at

# Signals span few dimensions if the energy of all further ones is this share at most (50 dB), if
# it falls by this factor behind the last one, and if there are this many signals a dimension.
LEAST_REST, LEAST_DROP, LEAST_SIGNALS = 1e-5, 30.0, 2
# Squared distance from the space, of a lobe of unit norm, at which the lobe lies in it (50 dB).
INSIDE = 1e-5
# Where the distance of a lobe from the space cannot be told from rounding.
EXACT = 1e-10
# Starts: the best of the bank for each model, no two of them more alike than this.
CANDIDATES, STARTS, START_LIKENESS = 400, 48, 0.97
STEPS, ROUNDS = 24, 4
# Pairs of most weight at which narrow lobes are tried.
PEAKS = 64
# Least part of a lobe that those found before must leave: what is smaller is rounding.
TINY = 1e-4


@dataclass(frozen=True)
class SpanSearch:
    """What the search shares.

    Attributes:
        grid, bank, feasible: of the stage.
        space: orthonormal rows that span the signals, `[r, D]`.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    space: Tensor

    def run(self) -> LobeBatch:
        """Lobes that lie in the space, no two alike."""
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
        return decode(model, coordinates)

    def _atoms(self, model: Tensor, coordinates: Tensor) -> Tensor:
        """Lobes of unit norm, `[J, D]`."""
        values = self.grid.eval(decode(model, coordinates))
        return values / values.norm(dim=1, keepdim=True)

    def _starts(self, basis: Tensor) -> Tensor:
        """Bank lobes nearest to the part of the space that `basis [J, D]` leaves."""
        along = (self.bank.atoms @ basis.T).square().sum(1)
        inside = (self.bank.atoms @ self.space.T).square().sum(1) - along
        score = (inside / (1.0 - along).clamp(min=TINY)).clamp(max=1.0)
        chosen = []
        for _, own in self.bank.lobes.by_model():
            best = own[score[own].argsort(descending=True)[:CANDIDATES]]
            kept = distinct(self.bank.atoms[best], START_LIKENESS)[:STARTS]
            chosen.append(best[kept])
        return torch.cat(chosen)

    def _descend(self, model: Tensor, start: Tensor, basis: Tensor) -> tuple[Tensor, Tensor]:
        """Coordinates `[J, P]` and squared distances `[J]` at the nearest minima.

        What lies along the lobes found before, `basis`, is taken out of every lobe: or those
        would attract all others [recursively applied and projected MUSIC, Mosher and Leahy 1999].
        """
        coordinates = start.clone()
        distance = self._distance(model, start, basis)
        damping = torch.full_like(distance, DAMPING_START)
        for _ in range(STEPS):
            rows = torch.nonzero(distance > EXACT).squeeze(1)
            if not len(rows):
                break
            own = model[rows]
            step = damped_step(*self._slopes(own, coordinates[rows], basis), damping[rows])
            trial = self.feasible.project(own, coordinates[rows] + step.to(start.dtype))
            there = self._distance(own, trial, basis)
            better = there < distance[rows]
            coordinates[rows] = torch.where(better[:, None], trial, coordinates[rows])
            distance[rows] = torch.where(better, there, distance[rows])
            damping[rows] = next_damping(damping[rows], better)
        return coordinates, distance

    def _distance(self, model: Tensor, coordinates: Tensor, basis: Tensor) -> Tensor:
        atoms = _without(self._atoms(model, coordinates), basis)
        rest = atoms.square().sum(1, dtype=torch.float64).clamp(min=TINY)
        outside = _without(atoms, self.space)
        return outside.square().sum(1, dtype=torch.float64) / rest

    def _slopes(self, model: Tensor, coordinates: Tensor, basis: Tensor) -> tuple[Tensor, Tensor]:
        """Hessian (Gauss-Newton) `[J, P, P]` and gradient `[J, P]` of half the distance."""
        parts = self.grid.jacobian(model[:, None], coordinates[:, None])
        rho, slope = (_without(part[:, 0], basis) for part in parts)  # [J, D], [J, P, D]
        norm = rho.norm(dim=1)
        atoms, slope = rho / norm[:, None], slope / norm[:, None, None]
        slope = slope - (slope @ atoms[..., None]) * atoms[:, None]  # of lobes of unit norm
        inner = slope @ self.space.T  # [J, P, r]
        hessian = slope @ slope.transpose(1, 2) - inner @ inner.transpose(1, 2)
        gradient = slope @ _without(atoms, self.space)[..., None]
        return hessian.double(), gradient.squeeze(-1).double()


def _without(values: Tensor, basis: Tensor) -> Tensor:
    """Rows `[..., D]` without what lies along orthonormal rows `basis [J, D]`."""
    return values - (values @ basis.T) @ basis


def spanned_space(signals: Tensor) -> Tensor:
    """Orthonormal rows `[r, D]` that span signals `[N, D]`; none if those fill every dimension."""
    norm = signals.norm(dim=1)
    signals = signals[norm > 0.0] / norm[norm > 0.0, None]
    gram = signals.double() @ signals.double().T
    energy, vectors = (part.flip(-1) for part in torch.linalg.eigh(gram))  # largest first
    energy = energy.clamp(min=torch.finfo(signals.dtype).eps ** 2 * len(signals))
    most = len(energy) // LEAST_SIGNALS
    rest = 1.0 - energy.cumsum(0)[:most] / energy.sum()  # behind 1, 2, ... dimensions
    drop = energy[:most] / energy[1 : most + 1]
    drop = torch.where(rest <= LEAST_REST, drop, 0.0)
    if not len(drop) or float(drop.max()) < LEAST_DROP:
        return signals[:0]
    rank = int(drop.argmax()) + 1
    rows = (vectors[:, :rank] / energy[:rank].sqrt()).T @ signals.double()
    return rows.to(signals.dtype)


def spanned_lobes(
    signals: Tensor, grid: DirectionGrid, bank: Bank, feasible: Feasible
) -> LobeBatch:
    """Lobes in the space that signals `[N, D]` span; none if that is not a small one."""
    space = spanned_space(signals)
    if len(space):
        bank = bank.joined(_peaks(space, grid, bank, feasible))
    return SpanSearch(grid, bank, feasible, space).run()


def _peaks(space: Tensor, grid: DirectionGrid, bank: Bank, feasible: Feasible) -> Bank:
    """Narrow lobes about the half vectors of the pairs that weigh most in the space.

    A lobe so narrow that few pairs see it fills the space at its peak, and no fixed bank of
    normals comes near enough.
    """
    weight = space.square().sum(0)  # the leverage of each pair, [D]
    light, view = grid.at(weight.topk(min(PEAKS, len(weight))).indices)
    half = torch.nn.functional.normalize(light + view, dim=1)
    used = {MODEL_NAMES[index] for index, _ in bank.lobes.by_model()}
    shapes = {name: rows for name, rows in PEAK_SHAPES.items() if name in used}
    return bank_at(grid, shapes, half, feasible) if shapes else bank
