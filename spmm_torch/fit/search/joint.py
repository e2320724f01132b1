"""Stage search, corrective: all lobes of a sample are refined together after each new one.

Lobes enter and leave as in the stagewise Lasso, but every step refits all weights of the sample by
NNLS and, by variable projection, all normals and parameters of its lobes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from torch import Tensor

from ...config.fit import SearchConfig
from ...lobes.batch import COORDINATES, Feasible, LobeBatch, encode
from ...lobes.grid import SAME_LOBE, DirectionGrid, distinct
from ...runtime.progress import Advance
from ...solvers.foba import select_foba
from ...solvers.multistart import StartCounts, best_start
from ...solvers.nnls import nnls_shared_gram
from ...solvers.status import Solver
from ...solvers.varpro import refine_mixtures
from .bank import Bank
from .exact import ExactErrors
from .functions import LobeFunctions
from .mixtures import Mixtures

# Relative error at which a sample is solved: 70 dB, the rounding of float32.
SOLVED = 1e-7
# Rows that one batch of restarts should fill, and most restarts, where the settings do not tell.
BATCH_ROWS, MAX_RESTARTS = 256, 8
# Values of a Jacobian that are held at once: 16 MB on a CPU, 4 GB on a GPU. What is over 32 MB goes
# back to the system, which clears its pages anew at every step.
CPU_JACOBIAN_VALUES, CUDA_JACOBIAN_VALUES = 1 << 22, 1 << 30
# Samples on which lobes are exchanged, spread over all clusters, with many restarts each. If there
# are more samples, a turn pays only while it takes this fraction of the error away.
FEW_ROWS, LEAST_GAIN = 32, 0.025
# Fraction of the samples that may creep on in a narrow valley, a few thousandths of their error a
# step, when all others have converged.
STRAGGLERS = 0.12
# Least denominator: the energy of a black sample and the norm of an invisible lobe are 0.
SMALLEST_NORMAL = torch.finfo(torch.float32).tiny


@dataclass(frozen=True)
class CorrectiveSearch:
    """The search of all samples.

    Attributes:
        grid, bank, feasible, config: of the stage.
        signals: `[S, C, D]`.
        known: lobes that are known beforehand, which every sample may use.
        counts: starts and selections by how they end.
        exact: errors by which mixtures are judged; None: the squared ones.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    config: SearchConfig
    signals: Tensor
    known: LobeBatch
    counts: StartCounts = field(default_factory=StartCounts)
    exact: ExactErrors | None = None

    @cached_property
    def energy(self) -> Tensor:
        """Error of each sample without lobes, its squared norm where errors are, `[S]` float64."""
        return self.squared_norm if self.exact is None else self.exact.energy

    @cached_property
    def squared_norm(self) -> Tensor:
        """Squared norm of each sample, `[S]` float64."""
        return (self.signals * self.signals).sum((1, 2), dtype=torch.float64)

    def run(self, advance: Advance) -> Mixtures:
        """Adds, refines and exchanges the lobes of every sample."""
        mixtures = self._empty()
        if len(self.known):
            self._select_from_all(mixtures)
        self._grow(mixtures, advance)
        self._polish(mixtures)
        self._exchange_in_turns(mixtures, advance)
        self._select_from_all(mixtures)
        return mixtures

    def _grow(self, mixtures: Mixtures, advance: Advance) -> None:
        """Adds lobes to every sample until no further one pays."""
        growing = mixtures.loss > SOLVED * self.energy
        for number in range(self.config.max_lobes):
            rows = torch.nonzero(growing & ~mixtures.present.all(1)).squeeze(1)
            if len(rows):
                empty = number == 0 and not len(self.known)
                growing[rows] = self._forward(mixtures, rows, empty)
            advance(len(growing))

    def _exchange_in_turns(self, mixtures: Mixtures, advance: Advance) -> None:
        """Exchanges lobes of unsolved samples, one a turn, while that pays."""
        samples = len(self.signals)
        idle = 0  # successive turns that did not pay
        for turn in range(self.config.exchanges):
            rows = self._unsolved(mixtures)
            few = rows[:: -(-len(rows) // FEW_ROWS) or 1]
            gain = self._exchange(mixtures, few, turn)
            advance(samples)
            idle = 0 if gain >= LEAST_GAIN else idle + 1
            if idle and (len(few) < len(rows) or idle == self.config.max_lobes):
                advance(samples * (self.config.exchanges - turn - 1))
                break

    def _polish(self, mixtures: Mixtures) -> None:
        """Refines all lobes of every unsolved sample."""
        rows = self._unsolved(mixtures)
        if len(rows):
            after = self._refine(mixtures.take(rows), rows, self.config.final_steps)
            if self.exact is None:
                mixtures.put(rows, after)
            else:
                self._put_better(mixtures, rows, self._settle(after, rows))

    def _empty(self) -> Mixtures:
        """Mixtures of all samples without lobes."""
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
        """Indices `[s]` of the samples that are not solved."""
        return torch.nonzero(mixtures.loss > SOLVED * self.energy).squeeze(1)

    def _forward(self, mixtures: Mixtures, rows: Tensor, empty: bool) -> Tensor:
        """Adds a lobe to samples `rows [s]`; True `[s]` where it paid and another may follow.

        It is known whether all mixtures are `empty`.
        """
        before = mixtures.take(rows)
        plain = empty and self.exact is None
        error = self.signals[rows] if plain else self._errors(before, rows)
        after = self._add_best(before, rows, error)
        gain = before.loss - after.loss
        paid = gain > torch.maximum(self.config.min_gain * before.loss, SOLVED * self.energy[rows])
        better = torch.nonzero(paid).squeeze(1)
        mixtures.put(rows[better], after.take(better))
        return paid & (after.loss > SOLVED * self.energy[rows])

    def _exchange(self, mixtures: Mixtures, rows: Tensor, turn: int) -> float:
        """Replaces one lobe of each of samples `rows [s]` where that lowers the error.

        The weakest lobe is tried first, then the next one with each `turn`. Returns the fraction
        of the error that this takes away, mean over the samples.
        """
        if not len(rows):
            return 0.0
        before = mixtures.take(rows)
        places = torch.arange(len(rows), device=rows.device).split(self._block)
        parts = [self._without_one(before.take(some), rows[some], turn) for some in places]
        present, error = (torch.cat(column) for column in zip(*parts, strict=True))
        without = Mixtures(before.model, before.coordinates, present, before.weights, before.loss)
        trial = self._add_best(without, rows, error)
        trial = self._settle(self._refine(trial, rows, self.config.final_steps), rows)
        self._put_better(mixtures, rows, trial)
        return float((1.0 - trial.loss / before.loss).clamp(min=0.0).mean())

    def _select_from_all(self, mixtures: Mixtures) -> None:
        """Fits every unsolved sample again with the lobes of all samples; keeps better fits.

        Samples of one material get stuck in different local minima, so lobes of one free another.
        """
        rows = self._unsolved(mixtures)
        pool = self._pool(mixtures)
        if not len(rows) or not len(pool):
            return
        coordinates = encode(pool)
        atoms = self.grid.eval(pool)
        atoms = atoms / atoms.norm(dim=1, keepdim=True).clamp(min=SMALLEST_NORMAL)
        signals = self.signals[rows]
        chosen = select_foba(
            atoms @ atoms.T,
            (signals @ atoms.T).transpose(1, 2),
            self.squared_norm[rows],
            max_lobes=self.config.max_lobes,
            min_gain=self.config.min_gain,
        )
        self.counts.add_problems(Solver.FOBA, chosen.status)
        self.counts.add_problems(Solver.NNLS, chosen.nnls_status)
        start = self._empty().take(rows)
        start.model[:] = pool.model[chosen.index.clamp(min=0)]
        start.coordinates[:] = coordinates[chosen.index.clamp(min=0)]
        start.present[:] = chosen.index >= 0
        trial = self._refine(start, rows, self.config.refine_steps)
        self._put_better(mixtures, rows, self._settle(trial, rows))

    def _put_better(self, mixtures: Mixtures, rows: Tensor, trial: Mixtures) -> None:
        """Takes those mixtures of a trial for samples `rows [s]` that have a lower error."""
        better = torch.nonzero(trial.loss < mixtures.loss[rows]).squeeze(1)
        mixtures.put(rows[better], trial.take(better))

    def _settle(self, mixtures: Mixtures, rows: Tensor) -> Mixtures:
        """The mixtures of samples `rows [s]`, refined by the errors that judge them."""
        if self.exact is None:
            return mixtures
        steps, tolerance = self.config.final_steps, self.config.tolerance
        return self.exact.refined(mixtures, rows, self.feasible, steps, tolerance, self._block)

    def _pool(self, mixtures: Mixtures) -> LobeBatch:
        """Known lobes, then those of all samples, best fits first, of which no two are alike."""
        order = (mixtures.loss / self.energy.clamp(min=SMALLEST_NORMAL)).argsort(stable=True)
        used = mixtures.present[order]
        own = self.grid.decode(mixtures.model[order][used], mixtures.coordinates[order][used])
        lobes = LobeBatch.cat([self.known, own])
        atoms = self.grid.eval(lobes)
        atoms = atoms / atoms.norm(dim=1, keepdim=True).clamp(min=SMALLEST_NORMAL)
        return lobes[distinct(atoms, SAME_LOBE)]

    def _without_one(self, mixtures: Mixtures, rows: Tensor, turn: int) -> tuple[Tensor, Tensor]:
        """The mixtures of samples `rows [s]` without their weakest lobe, or that of a later `turn`.

        Returns:
            (lobes that stay `[s, M]` bool; what is to be added to these, with their best weights,
            `[s, C, D]`; see `_errors`).
        """
        rho, signals = self.grid.values(mixtures.model, mixtures.coordinates), self.signals[rows]
        energy = mixtures.weights.square().sum(2) * rho.square().sum(2)  # [s, M]
        order = torch.where(mixtures.present, energy, torch.inf).argsort(1)
        place = turn % mixtures.present.sum(1).clamp(min=1)  # [s]
        present = mixtures.present.scatter(1, order.gather(1, place[:, None]), False)
        gram, correlation = rho @ rho.transpose(1, 2), signals @ rho.transpose(1, 2)
        weights = nnls_shared_gram(gram.double(), correlation.double(), allowed=present).weights
        weights = weights.to(rho.dtype)
        if self.exact is None:
            return present, signals - weights @ rho
        without = replace(mixtures, present=present, weights=weights.transpose(1, 2))
        return present, self.exact.downward(without, rows)

    def _add_best(self, mixtures: Mixtures, rows: Tensor, error: Tensor) -> Mixtures:
        """The mixtures of samples `rows [s]` with one more lobe, the best of several starts.

        `error [s, C, D]` is what the mixtures leave of the signals.
        """
        restarts = self.config.restarts
        if restarts is None:
            restarts = max(1, min(MAX_RESTARTS, BATCH_ROWS // len(rows)))
        starts = self._starts(error, restarts)  # [R, s], indices into the bank
        slot = (~mixtures.present).to(torch.int8).argmax(1)  # the first free one, [s]
        each = torch.arange(len(rows), device=rows.device).repeat(len(starts))
        joined = self._with_lobe(mixtures.take(each), slot[each], starts.flatten())
        refined = self._refine(joined, rows[each], self.config.refine_steps)
        which = best_start(refined.loss.view(len(starts), -1))  # [s]
        return refined.take(which * len(rows) + torch.arange(len(rows), device=which.device))

    def _starts(self, error: Tensor, count: int) -> Tensor:
        """Bank lobes `[count, s]` that lower the error `[s, C, D]` most, the best one first.

        The best lobe of each model comes before any second one of a model.
        """
        score = (self.bank.atoms @ error.flatten(0, 1).T).clamp(min=0.0).square()  # [A, s C]
        score = score.view(len(score), len(error), -1).sum(2)  # [A, s]
        leaders = [own[score[own].argmax(0)] for _, own in self.bank.by_model]
        best = torch.stack(leaders)  # [models, s]
        order = score.gather(0, best).argsort(dim=0, descending=True)
        best = best.gather(0, order)
        if count > len(best):
            more = score.scatter(0, best, -1.0).topk(count - len(best), dim=0).indices
            best = torch.cat((best, more))
        return best[:count]

    def _errors(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """What is to be added to the mixtures of samples `rows [s]`, `[s, C, D]`.

        That is the signals minus the mixtures, unless other errors count.
        """
        if len(rows) <= self._block:
            return self._left(mixtures, rows)
        places = torch.arange(len(rows), device=rows.device).split(self._block)
        parts = [self._left(mixtures.take(some), rows[some]) for some in places]
        return torch.cat(parts)

    def _left(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """`_errors` of as many samples as the memory takes."""
        if self.exact is None:
            return self.signals[rows] - mixtures.values(self.grid)
        return self.exact.downward(mixtures, rows)

    def _with_lobe(self, mixtures: Mixtures, slot: Tensor, atom: Tensor) -> Mixtures:
        """The mixtures with bank lobes `atom [s]` in `slot [s]`."""
        row = torch.arange(len(slot), device=slot.device)
        model = mixtures.model.clone()
        model[row, slot] = self.bank.lobes.model[atom]
        coordinates = mixtures.coordinates.clone()
        coordinates[row, slot] = self.bank.coordinates[atom]
        present = mixtures.present.scatter(1, slot[:, None], True)
        return Mixtures(model, coordinates, present, mixtures.weights, mixtures.loss)

    def _refine(self, mixtures: Mixtures, rows: Tensor, steps: int) -> Mixtures:
        """Fits weights, and by `steps` steps coordinates, to the signals `rows [s]`."""
        slot = torch.arange(1, mixtures.present.shape[1] + 1, device=rows.device)
        used = max(1, int((mixtures.present * slot).max()))
        lobes = LobeFunctions(self.grid, self.feasible, mixtures.model[:, :used])
        result = refine_mixtures(
            lobes.values,
            lobes.linearized,
            lobes.project,
            mixtures.coordinates[:, :used],
            mixtures.present[:, :used],
            self.signals[rows],
            iterations=steps,
            tolerance=self.config.tolerance,
            stragglers=STRAGGLERS,
            block=self._block,
        )
        self.counts.add_starts({Solver.VARPRO: result.status})
        coordinates, weights = mixtures.coordinates.clone(), torch.zeros_like(mixtures.weights)
        coordinates[:, :used], weights[:, :used] = result.coordinates, result.weights
        found = Mixtures(mixtures.model, coordinates, mixtures.present, weights, result.loss)
        if self.exact is None:
            return found
        return replace(found, loss=self.exact.loss(found, rows, self._block))

    @property
    def _block(self) -> int:
        """Samples whose Jacobian fits the memory."""
        budget = CUDA_JACOBIAN_VALUES if self.signals.is_cuda else CPU_JACOBIAN_VALUES
        values = self.config.max_lobes * (1 + COORDINATES) * self.grid.pair_count
        return max(1, budget // values)
