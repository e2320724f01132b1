"""Stage search, stagewise: the paper's infinite-dictionary stagewise Lasso [WDR11 §3.2, ZY07].

Every iteration searches the lobe best correlated with what is left of each sample and channel
(Eq. 5), keeps the channel that correlates best, and moves weights by eta, forward or backward.
All samples, channels, models and starts are one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ...config.fit import SearchConfig, StagewiseConfig
from ...lobes.batch import COORDINATES, Feasible, decode
from ...lobes.grid import SAME_LOBE, DirectionGrid
from ...solvers.adam import minimize_adam
from ...solvers.lbfgs import OptimizeResult, minimize_lbfgs
from ...solvers.multistart import StartTally
from ...solvers.status import Solver, Status, worst_status
from .bank import Bank
from .mixtures import Mixtures

# xi of [ZY07] in units of eta^2, above the rounding of float32.
STEP_TOLERANCE = 1e-3
# Direction pairs are drawn by energy with this share of uniform draws, so that dark pairs count.
UNIFORM_SHARE = 0.3
# First length of Adam's steps, in search coordinates (parameters run from 0 to 1).
LEARNING_RATE = 0.05
# Squared norm under which a lobe is not visible on the drawn pairs.
NORM_EPS = 1e-12
# (lobe, pair) values that Eq. 5 holds at once with their gradients.
CPU_VALUES, CUDA_VALUES = 1 << 22, 1 << 27

Advance = Callable[[int], None]


@dataclass
class _Path:
    """The growing lobes of S samples; M slots."""

    model: Tensor  # [S, M]
    coordinates: Tensor  # [S, M, P]
    atoms: Tensor  # [S, M, D], unit norm
    weights: Tensor  # [S, C, M], multiples of eta
    count: Tensor  # [S] slots in use
    penalty: Tensor  # [S] lambda
    running: Tensor  # [S]


@dataclass(frozen=True)
class StagewiseSearch:
    """What the iterations share.

    Attributes:
        grid, bank, feasible, config, stagewise: as given to the search.
        signals: `[S, C, D]`.
        pairs: direction pairs on which Eq. 5 is climbed, `[S, N]`, drawn by energy.
        importance: square roots of their weights, `[S, N]`, that keep inner products unbiased.
        tally: counts how starts and paths end.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    config: SearchConfig
    stagewise: StagewiseConfig
    signals: Tensor
    pairs: Tensor
    importance: Tensor
    tally: StartTally = field(default_factory=StartTally)

    @classmethod
    def build(
        cls,
        grid: DirectionGrid,
        bank: Bank,
        feasible: Feasible,
        config: SearchConfig,
        stagewise: StagewiseConfig,
        signals: Tensor,
        generator: torch.Generator,
    ) -> StagewiseSearch:
        """Draws the pairs: uniform draws alone would miss the specular peaks."""
        energy = signals.square().sum(1)  # [S, D]
        share = energy / energy.sum(1, keepdim=True).clamp(min=NORM_EPS)
        chance = (UNIFORM_SHARE / grid.pair_count + (1.0 - UNIFORM_SHARE) * share).cpu()
        drawn = torch.multinomial(chance, config.pairs, replacement=True, generator=generator)
        chosen = chance.gather(1, drawn)
        importance = (config.pairs * chosen).rsqrt()
        device = signals.device
        drawn, importance = drawn.to(device), importance.to(device)
        return cls(grid, bank, feasible, config, stagewise, signals, drawn, importance)

    def run(self, advance: Advance) -> Mixtures:
        """Follows the path of every sample to lambda_min, then drops weights under 2 eta."""
        samples, channels, width = self.signals.shape
        norm = self.signals.square().sum((1, 2)).sqrt()  # [S]
        eta = self.stagewise.eta * self.signals.norm(dim=2)  # [S, C]
        path = self._start(samples, channels, width)
        path.running &= norm > 0.0
        for _ in range(self.stagewise.max_steps):
            before = int(path.running.sum())
            if before == 0:
                break
            self._iterate(path, eta, self.stagewise.lambda_min * norm)
            advance(before - int(path.running.sum()))
        advance(int(path.running.sum()))
        none = torch.zeros_like(path.running)
        self.tally.count(
            Solver.STAGEWISE_LASSO, worst_status(~path.running, none, ~norm.isfinite())
        )
        kept = (path.weights >= 2.0 * eta[..., None] * (1.0 - STEP_TOLERANCE)).any(1)
        error = self.signals - path.weights @ path.atoms
        return Mixtures(
            path.model,
            path.coordinates,
            kept,
            path.weights.transpose(1, 2),
            error.square().sum((1, 2)).double(),
        )

    def _start(self, samples: int, channels: int, width: int) -> _Path:
        device, slots = self.signals.device, self.config.max_lobes
        return _Path(
            torch.zeros(samples, slots, dtype=torch.long, device=device),
            torch.zeros(samples, slots, COORDINATES, device=device),
            torch.zeros(samples, slots, width, device=device),
            torch.zeros(samples, channels, slots, device=device),
            torch.zeros(samples, dtype=torch.long, device=device),
            torch.full((samples,), torch.inf, device=device),
            torch.ones(samples, dtype=torch.bool, device=device),
        )

    def _iterate(self, path: _Path, eta: Tensor, lambda_min: Tensor) -> None:
        """One backward step where it lowers the penalized loss, else one forward step."""
        rows = torch.nonzero(path.running).squeeze(1)
        error = self.signals[rows] - path.weights[rows] @ path.atoms[rows]  # [s, C, D]
        step = eta[rows]  # [s, C]
        slope = path.atoms[rows] @ error.transpose(1, 2)  # [s, M, C]
        active = path.weights[rows].transpose(1, 2) > 0.5 * step[:, None]  # [s, M, C]
        rise = ((2.0 * step[:, None] * slope + step[:, None] ** 2) * active).sum(2)
        length = (step[:, None] * active).sum(2)  # [s, M]
        slack = STEP_TOLERANCE * step.square().sum(1)
        change = torch.where(length > 0.0, rise - path.penalty[rows, None] * length, torch.inf)
        lowest, slot = change.min(1)
        back = lowest < -slack
        self._move(path, rows[back], slot[back], -step[back] * _at(active, slot)[back])
        rows, error, step, slack = rows[~back], error[~back], step[~back], slack[~back]
        if not len(rows):
            return
        slot = self._find(path, rows, error)
        slope = torch.einsum("sd,scd->sc", path.atoms[rows, slot], error)
        fall = 2.0 * step * slope - step * step  # [s, C]
        stepped = step * (fall > 0.0)
        penalty = (fall.clamp(min=0.0).sum(1) - slack) / stepped.sum(1).clamp(min=NORM_EPS)
        penalty = torch.minimum(path.penalty[rows], penalty)
        going = (stepped.sum(1) > 0.0) & (penalty > lambda_min[rows])
        self._move(path, rows[going], slot[going], stepped[going])
        path.penalty[rows] = torch.where(going, penalty, path.penalty[rows])
        path.running[rows[~going]] = False

    @staticmethod
    def _move(path: _Path, rows: Tensor, slot: Tensor, step: Tensor) -> None:
        """Adds `step [s, C]` to the weights of one slot of samples `rows [s]`."""
        moved = path.weights[rows, :, slot] + step
        path.weights[rows, :, slot] = moved.clamp(min=0.0)

    def _find(self, path: _Path, rows: Tensor, error: Tensor) -> Tensor:
        """Slots `[s]` of the lobes best correlated with `error [s, C, D]`, made where new."""
        model, coordinates = self._search(rows, error)
        lobes = decode(model.reshape(-1), coordinates)
        values = self.grid.eval(lobes)  # [s C, D]
        values = values / values.norm(dim=1, keepdim=True).clamp(min=NORM_EPS)
        values = values.view_as(error)
        # Each channel on its own; the one with the best correlation gives the lobe [WDR11 §3.2].
        match = (values * error).sum(2) / error.norm(dim=2).clamp(min=NORM_EPS)
        channel = match.argmax(1)  # [s]
        atom = _at(values, channel)  # [s, D]
        likeness = torch.einsum("smd,sd->sm", path.atoms[rows], atom)
        nearest, slot = likeness.max(1)
        full = path.count[rows] == path.atoms.shape[1]
        known = (nearest > SAME_LOBE) | full
        slot = torch.where(known, slot, path.count[rows].clamp(max=path.atoms.shape[1] - 1))
        new = ~known
        where, place = rows[new], slot[new]
        chosen = (torch.arange(len(rows), device=rows.device), channel)
        path.model[where, place] = model[chosen][new]
        path.coordinates[where, place] = coordinates.view(*error.shape[:2], -1)[chosen][new]
        path.atoms[where, place] = atom[new]
        path.count[where] += 1
        return slot

    def _search(self, rows: Tensor, error: Tensor) -> tuple[Tensor, Tensor]:
        """Eq. 5 for every sample and channel: (model `[s, C]`, coordinates `[s C, P]`).

        The bank gives the start of every model; the winner is judged on all direction pairs.
        """
        signals = error.flatten(0, 1)  # [s C, D]
        score = self.bank.atoms @ signals.T  # [A, s C]
        best_model = signals.new_zeros(len(signals), dtype=torch.long)
        best_value = torch.full((len(signals),), -torch.inf, device=signals.device)
        best = torch.zeros(len(signals), COORDINATES, device=signals.device)
        for index, own in self.bank.lobes.by_model():
            start = self.bank.coordinates[own[score[own].argmax(0)]]  # [s C, P]
            model = torch.full_like(best_model, index)
            found = self._climb(model, start, rows, error)
            value = self._correlation(model, found, signals)
            kept = self._correlation(model, start, signals)  # the draw of pairs may mislead
            found = torch.where((value >= kept)[:, None], found, start)
            value = torch.where(value >= kept, value, kept)  # False for NaN
            better = value > best_value
            best_value = torch.where(better, value, best_value)
            best = torch.where(better[:, None], found, best)
            best_model = torch.where(better, index, best_model)
        return best_model.view(error.shape[:2]), best

    def _correlation(self, model: Tensor, coordinates: Tensor, signals: Tensor) -> Tensor:
        """<rho, mu> / ||rho|| on all pairs, `[R]`."""
        rho = self.grid.eval(decode(model, coordinates))
        return (rho * signals).sum(1) / rho.norm(dim=1).clamp(min=NORM_EPS)

    def _climb(self, model: Tensor, start: Tensor, rows: Tensor, error: Tensor) -> Tensor:
        """Adam, then L-BFGS, each row a problem of its own, on the drawn pairs."""
        channels = error.shape[1]
        budget = CUDA_VALUES if error.is_cuda else CPU_VALUES
        size = max(1, budget // (self.config.pairs * channels)) * channels
        parts = []
        for first in range(0, len(start), size):
            chunk = slice(first, first + size)
            samples = torch.arange(first, min(first + size, len(start)), device=rows.device)
            samples, channel = samples // channels, samples % channels
            pairs = self.pairs[rows[samples]]  # [r, N]
            importance = self.importance[rows[samples]]
            target = error[samples, channel].gather(1, pairs) * importance
            problem = _Correlation(self.grid, model[chunk], pairs, importance, target)
            feasible = self.feasible
            project = _Projection(feasible, model[chunk])
            climbed = minimize_adam(
                problem,
                start[chunk],
                project,
                steps=self.config.adam_steps,
                learning_rate=LEARNING_RATE,
            )
            result = minimize_lbfgs(problem, climbed.x, project, iterations=self.config.lbfgs_steps)
            self.tally.add({Solver.ADAM: climbed.status, Solver.LBFGS: result.status})
            parts.append(_or_start(result, start[chunk]))
        return torch.cat(parts)


@dataclass(frozen=True)
class _Projection:
    """Feasible coordinates of rows of given models."""

    feasible: Feasible
    model: Tensor

    def __call__(self, coordinates: Tensor) -> Tensor:
        return self.feasible.project(self.model, coordinates)


@dataclass(frozen=True)
class _Correlation:
    """Minus Eq. (5) of R rows on their own N pairs, and its gradient.

    Attributes:
        model: `[R]`.
        pairs, importance: `[R, N]`.
        target: what is left of the signal there, times importance, `[R, N]`.
    """

    grid: DirectionGrid
    model: Tensor
    pairs: Tensor
    importance: Tensor
    target: Tensor

    def __call__(self, coordinates: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            x = coordinates.detach().requires_grad_()
            rho = self.grid.eval_at(decode(self.model, x), self.pairs) * self.importance
            norm = (rho.square().sum(1) + NORM_EPS).sqrt()
            size = self.target.norm(dim=1).clamp(min=NORM_EPS)
            value = -(rho * self.target).sum(1) / (norm * size)  # Eq. (5)
            (gradient,) = torch.autograd.grad(value.sum(), x)
        return value.detach(), gradient


def _at(values: Tensor, index: Tensor) -> Tensor:
    """`values[s, index[s]]` of `values [S, N, ...]`."""
    return values[torch.arange(len(index), device=values.device), index]


def _or_start(result: OptimizeResult, start: Tensor) -> Tensor:
    """The optimum of each row, or its start where the optimizer met NaN or infinity."""
    return torch.where((result.status == Status.NOT_FINITE)[:, None], start, result.x)
