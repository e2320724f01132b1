"""Stage search, corrective: all lobes of a sample are refined together after each new one.

Forward and backward steps as in the stagewise Lasso, but every step ends in a full refit of the
weights and, by variable projection, of all normals and parameters of the sample's lobes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from ...config.fit import SearchConfig
from ...lobes.batch import COORDINATES, Feasible, LobeBatch, decode, encode
from ...lobes.grid import SAME_LOBE, DirectionGrid, distinct
from ...runtime.progress import Advance
from ...solvers.foba import select_corrective
from ...solvers.multistart import StartTally, best_start
from ...solvers.status import Solver
from ...solvers.varpro import refine_mixtures
from .bank import Bank
from .mixtures import Mixtures

# A sample whose error is this share of its energy is done: 70 dB, the rounding of float32.
ENERGY_FLOOR = 1e-7
# Rows that one batch of restarts should fill, and restarts at most, where none are asked for.
BATCH_ROWS, MAX_RESTARTS = 256, 8
# Values of slopes that are held at once: 64 MB on a CPU, 4 GB on a GPU.
CPU_SLOPES, CUDA_SLOPES = 1 << 24, 1 << 30

# Lobes are exchanged on so many samples, spread over all clusters, with many restarts each; where
# there are more samples, they go on only while that takes this share of the error away.
FEW_ROWS, LEAST_GAIN = 32, 0.03
# Keeps the ratio of a loss to the energy of a black sample finite.
TINY = torch.finfo(torch.float32).tiny


@dataclass(frozen=True)
class CorrectiveSearch:
    """What the steps of the search share.

    Attributes:
        grid, bank, feasible, config: as given to the search.
        signals: `[S, C, D]`.
        known: lobes found beforehand, which all samples may borrow.
        tally: counts how starts and selections end.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    config: SearchConfig
    signals: Tensor
    known: LobeBatch
    tally: StartTally = field(default_factory=StartTally)

    @cached_property
    def energy(self) -> Tensor:
        """Squared norm of each sample, `[S]` float64."""
        return (self.signals * self.signals).sum((1, 2), dtype=torch.float64)

    def run(self, advance: Advance) -> Mixtures:
        """Grows, exchanges and polishes the lobes of every sample."""
        mixtures = self._empty()
        self._borrow(mixtures)
        growing = mixtures.loss > ENERGY_FLOOR * self.energy
        for _ in range(self.config.max_lobes):
            rows = torch.nonzero(growing & ~mixtures.present.all(1)).squeeze(1)
            if len(rows):
                growing[rows] = self._forward(mixtures, rows)
            advance(len(growing))
        self._polish(mixtures)
        idle = 0  # turns in a row that did not pay
        for turn in range(self.config.exchanges):
            rows = self._unsolved(mixtures)
            few = rows[:: -(-len(rows) // FEW_ROWS) or 1]
            gain = self._exchange(mixtures, few, turn)
            advance(len(growing))
            idle = 0 if gain >= LEAST_GAIN else idle + 1
            if idle and (len(few) < len(rows) or idle == self.config.max_lobes):
                advance(len(growing) * (self.config.exchanges - turn - 1))
                break
        self._borrow(mixtures)
        return mixtures

    def _polish(self, mixtures: Mixtures) -> None:
        rows = self._unsolved(mixtures)
        if len(rows):
            mixtures.put(rows, self._refine(mixtures.take(rows), rows, self.config.final_steps))

    def _empty(self) -> Mixtures:
        samples, channels, _ = self.signals.shape
        slots = self.config.max_lobes
        return Mixtures(
            self.signals.new_zeros(samples, slots, dtype=torch.long),
            self.signals.new_zeros(samples, slots, COORDINATES),
            self.signals.new_zeros(samples, slots, dtype=torch.bool),
            self.signals.new_zeros(samples, slots, channels),
            self.energy.clone(),
        )

    def _unsolved(self, mixtures: Mixtures) -> Tensor:
        return torch.nonzero(mixtures.loss > ENERGY_FLOOR * self.energy).squeeze(1)

    def _forward(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """Adds a lobe to samples `rows [s]`; True where it paid and another may follow."""
        before = mixtures.take(rows)
        after = self._add_best(before, rows)
        gain = before.loss - after.loss
        paid = gain > torch.maximum(
            self.config.min_gain * before.loss, ENERGY_FLOOR * self.energy[rows]
        )
        mixtures.put(rows[paid], after.take(torch.nonzero(paid).squeeze(1)))
        return paid & (after.loss > ENERGY_FLOOR * self.energy[rows])

    def _exchange(self, mixtures: Mixtures, rows: Tensor, turn: int) -> float:
        """Searches a better lobe in the place of one of each of samples `rows [s]`.

        The weakest goes first, and so on by `turn`. Returns the mean share of the error that this
        took away.
        """
        if not len(rows):
            return 0.0
        before = mixtures.take(rows)
        share = before.weights.square().sum(2) * self._norms(before)
        order = torch.where(before.present, share, torch.inf).argsort(1)
        place = turn % before.present.sum(1).clamp(min=1)  # [s]
        dropped = order.gather(1, place[:, None])  # [s, 1]
        present = before.present.scatter(1, dropped, False)
        without = Mixtures(before.model, before.coordinates, present, before.weights, before.loss)
        trial = self._add_best(self._refine(without, rows, 0), rows)
        trial = self._refine(trial, rows, self.config.final_steps)
        better = torch.nonzero(trial.loss < before.loss).squeeze(1)
        mixtures.put(rows[better], trial.take(better))
        return float((1.0 - trial.loss / before.loss).clamp(min=0.0).mean())

    def _borrow(self, mixtures: Mixtures) -> None:
        """Fits every unsolved sample anew with the lobes of all samples, and keeps what is better.

        Samples of one material get stuck in different places: what one of them found frees
        another. Lobes known beforehand are lent too.
        """
        rows = self._unsolved(mixtures)
        pool = self._pool(mixtures)
        if not len(rows) or not len(pool):
            return
        coordinates = encode(pool)
        atoms = self.grid.eval(pool)
        atoms = atoms / atoms.norm(dim=1, keepdim=True).clamp(min=TINY)
        signals = self.signals[rows]
        chosen = select_corrective(
            atoms @ atoms.T,
            (signals @ atoms.T).transpose(1, 2),
            self.energy[rows],
            max_lobes=self.config.max_lobes,
            min_gain=self.config.min_gain,
        )
        self.tally.count(Solver.FOBA, chosen.status)
        self.tally.count(Solver.NNLS, chosen.nnls_status)
        start = self._empty().take(rows)
        start.model[:] = pool.model[chosen.index.clamp(min=0)]
        start.coordinates[:] = coordinates[chosen.index.clamp(min=0)]
        start.present[:] = chosen.index >= 0
        trial = self._refine(start, rows, self.config.refine_steps)
        better = torch.nonzero(trial.loss < mixtures.loss[rows]).squeeze(1)
        mixtures.put(rows[better], trial.take(better))

    def _pool(self, mixtures: Mixtures) -> LobeBatch:
        """Known lobes, then those of all samples, the best fits first; no two alike."""
        order = (mixtures.loss / self.energy.clamp(min=TINY)).argsort(stable=True)
        used = mixtures.present[order]
        own = decode(mixtures.model[order][used], mixtures.coordinates[order][used])
        lobes = LobeBatch.cat([self.known, own])
        atoms = self.grid.eval(lobes)
        atoms = atoms / atoms.norm(dim=1, keepdim=True).clamp(min=TINY)
        return lobes[distinct(atoms, SAME_LOBE)]

    def _norms(self, mixtures: Mixtures) -> Tensor:
        """Squared norm of every lobe, `[S, M]`."""
        parts = [
            self.grid.values(mixtures.model[chunk], mixtures.coordinates[chunk]).square().sum(2)
            for chunk in self._chunks(len(mixtures.loss))
        ]
        return torch.cat(parts)

    def _add_best(self, mixtures: Mixtures, rows: Tensor) -> Mixtures:
        """Mixtures with one more lobe, the best of several starts."""
        restarts = self.config.restarts
        if restarts is None:
            restarts = max(1, min(MAX_RESTARTS, BATCH_ROWS // len(rows)))
        starts = self._starts(mixtures, rows, restarts)  # [R, s], indices into the bank
        slot = (~mixtures.present).to(torch.int8).argmax(1)  # the first free one, [s]
        trials = [self._with_lobe(mixtures, slot, start) for start in starts]
        columns = zip(*(trial.tensors() for trial in trials), strict=True)
        joined = Mixtures(*(torch.cat(column) for column in columns))
        refined = self._refine(joined, rows.repeat(len(starts)), self.config.refine_steps)
        which = best_start(refined.loss.view(len(starts), -1))  # [s]
        return refined.take(which * len(rows) + torch.arange(len(rows), device=which.device))

    def _starts(self, mixtures: Mixtures, rows: Tensor, count: int) -> Tensor:
        """Bank atoms that take away most of the remaining error, `[count, s]`, models apart.

        The first is the best of all; each further one is the best of another model, and only
        when the models run out does the list go on by score alone.
        """
        error = self._errors(mixtures, rows)  # [s, C, D]
        score = (self.bank.atoms @ error.flatten(0, 1).T).clamp(min=0.0).square()  # [A, s C]
        score = score.view(len(score), len(rows), -1).sum(2)  # [A, s]
        leaders = [own[score[own].argmax(0)] for _, own in self.bank.lobes.by_model()]
        best = torch.stack(leaders)  # [models, s]
        order = score.gather(0, best).argsort(dim=0, descending=True)
        best = best.gather(0, order)
        if count > len(best):
            more = score.scatter(0, best, -1.0).topk(count - len(best), dim=0).indices
            best = torch.cat((best, more))
        return best[:count]

    def _errors(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """What the mixtures leave of the signals `rows`, `[s, C, D]`."""
        parts = []
        for chunk in self._chunks(len(rows)):
            rho = self.grid.values(mixtures.model[chunk], mixtures.coordinates[chunk])
            weights = (mixtures.weights * mixtures.present[..., None])[chunk].transpose(1, 2)
            parts.append(self.signals[rows[chunk]] - weights @ rho)
        return torch.cat(parts)

    def _with_lobe(self, mixtures: Mixtures, slot: Tensor, atom: Tensor) -> Mixtures:
        """The mixtures with bank lobe `atom [s]` in `slot [s]`."""
        row = torch.arange(len(slot), device=slot.device)
        model = mixtures.model.clone()
        model[row, slot] = self.bank.lobes.model[atom]
        coordinates = mixtures.coordinates.clone()
        coordinates[row, slot] = self.bank.coordinates[atom]
        present = mixtures.present.scatter(1, slot[:, None], True)
        return Mixtures(model, coordinates, present, mixtures.weights, mixtures.loss)

    def _refine(self, mixtures: Mixtures, rows: Tensor, steps: int) -> Mixtures:
        """Weights, and by `steps` steps all coordinates, fit anew to the signals `rows`."""
        used = int(mixtures.present.any(0).nonzero().max()) + 1 if mixtures.present.any() else 1
        parts = []
        for chunk in self._chunks(len(rows)):
            model = mixtures.model[chunk, :used]
            result = refine_mixtures(
                lambda x, i, model=model: self.grid.values(model[i], x),
                lambda x, i, model=model: self.grid.jacobian(model[i], x),
                lambda x, i, model=model: self.feasible.project(
                    model[i].reshape(-1), x.flatten(0, 1)
                ).view_as(x),
                mixtures.coordinates[chunk, :used],
                mixtures.present[chunk, :used],
                self.signals[rows[chunk]],
                iterations=steps,
                tolerance=self.config.tolerance,
            )
            self.tally.add({Solver.VARPRO: result.status})
            parts.append(result)
        coordinates, weights = mixtures.coordinates.clone(), torch.zeros_like(mixtures.weights)
        coordinates[:, :used] = torch.cat([part.coordinates for part in parts])
        weights[:, :used] = torch.cat([part.weights for part in parts])
        loss = torch.cat([part.loss for part in parts])
        return Mixtures(mixtures.model, coordinates, mixtures.present, weights, loss)

    def _chunks(self, rows: int) -> list[slice]:
        """Slices of samples whose slopes fit the memory."""
        budget = CUDA_SLOPES if self.signals.is_cuda else CPU_SLOPES
        values = self.config.max_lobes * COORDINATES * self.grid.pair_count
        size = max(1, budget // values)
        return [slice(i, min(i + size, rows)) for i in range(0, rows, size)]
