"""Stage search, stagewise: the Lasso with an infinite dictionary of the paper [WDR11 §3.2, ZY07].

Every iteration finds the lobe that correlates best with the residual of each sample and channel
(Eq. 5), keeps that of the channel with the highest correlation, and moves weights by eta, forward
or backward. All samples, channels and starts of a model are one batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from ...config.fit import SearchConfig, StagewiseConfig
from ...lobes.batch import COORDINATES, Feasible
from ...lobes.grid import SAME_LOBE, DirectionGrid
from ...runtime.progress import Advance
from ...solvers.adam import minimize_adam
from ...solvers.lbfgs import OptimizeResult, minimize_lbfgs
from ...solvers.multistart import StartCounts
from ...solvers.stagewise_lasso import STEP_TOLERANCE, THRESHOLD_SLACK
from ...solvers.status import Solver, Status, worst_status
from .bank import Bank
from .mixtures import Mixtures

# Fraction of the direction pairs that is drawn uniformly rather than by energy, for dark pairs.
UNIFORM_FRACTION = 0.3
# First length of the steps of Adam, in search coordinates (parameters run from 0 to 1).
LEARNING_RATE = 0.05
# Least denominator, such as the norm of a lobe that no pair sees.
LEAST_DENOMINATOR = 1e-12
# Added to a squared norm, whose root then has a finite gradient.
ROOT_RIDGE = 1e-12
# Units of progress of one path.
PATH_UNITS = 100
# (lobe, pair) values that Eq. 5 holds at once with their gradients.
CPU_VALUES, CUDA_VALUES = 1 << 22, 1 << 27


@dataclass
class _Path:
    """The lobes of S samples on the path, in M slots."""

    model: Tensor  # [S, M]
    coordinates: Tensor  # [S, M, P]
    atoms: Tensor  # [S, M, D], unit norm
    weights: Tensor  # [S, C, M], multiples of eta
    count: Tensor  # [S], slots in use
    penalty: Tensor  # [S], lambda
    running: Tensor  # [S] bool


@dataclass(frozen=True)
class StagewiseSearch:
    """The paths of all samples [WDR11 §3.2].

    Attributes:
        grid, bank, feasible, config, stagewise: of the stage.
        signals: `[S, C, D]`.
        pairs: direction pairs on which Eq. 5 is optimized, `[S, N]`: all, or drawn by energy.
        importance: 1 / sqrt(N probability) of each, `[S, N]`: keeps inner products unbiased.
        counts: starts and paths by how they end.
    """

    grid: DirectionGrid
    bank: Bank
    feasible: Feasible
    config: SearchConfig
    stagewise: StagewiseConfig
    signals: Tensor
    pairs: Tensor
    importance: Tensor
    counts: StartCounts = field(default_factory=StartCounts)

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
        """A search on drawn pairs, or on all where no more are asked for than there are.

        Args:
            grid, bank, feasible, config, stagewise: of the stage.
            signals: `[S, C, D]`.
            generator: draws the pairs.
        """
        probability = _probability(signals).cpu()
        if grid.pair_count <= config.pairs:  # draws would only repeat pairs
            drawn = torch.arange(grid.pair_count).expand_as(probability)
            importance = torch.ones_like(probability)
        else:
            drawn = torch.multinomial(
                probability, config.pairs, replacement=True, generator=generator
            )
            importance = (config.pairs * probability.gather(1, drawn)).rsqrt()
        device = signals.device
        drawn, importance = drawn.to(device), importance.to(device)
        return cls(grid, bank, feasible, config, stagewise, signals, drawn, importance)

    def run(self, advance: Advance) -> Mixtures:
        """Follows the path of every sample down to lambda_min, then drops weights under 2 eta."""
        samples, channels, width = self.signals.shape
        norm = self.signals.square().sum((1, 2)).sqrt()  # [S]
        eta = self.stagewise.eta * self.signals.norm(dim=2)  # [S, C]
        path = self._start(samples, channels, width)
        path.running &= norm > 0.0
        end, done = self.stagewise.lambda_min * norm, 0
        first = torch.full_like(norm, torch.inf)  # penalty after the first step
        for _ in range(self.stagewise.max_steps):
            if not bool(path.running.any()):
                break
            self._iterate(path, eta, end)
            first = torch.where(first.isinf(), path.penalty, first)
            now = int((PATH_UNITS * _gone(path, first, end)).sum())
            advance(max(now - done, 0))
            done = max(now, done)
        advance(PATH_UNITS * samples - done)
        none = torch.zeros_like(path.running)
        self.counts.add_problems(
            Solver.STAGEWISE_LASSO, worst_status(~path.running, none, ~norm.isfinite())
        )
        kept = (path.weights >= 2.0 * eta[..., None] * (1.0 - THRESHOLD_SLACK)).any(1)
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
        correlation = path.atoms[rows] @ error.transpose(1, 2)  # [s, M, C]
        active = path.weights[rows].transpose(1, 2) > 0.5 * step[:, None]  # [s, M, C]
        rise = ((2.0 * step[:, None] * correlation + step[:, None] ** 2) * active).sum(2)
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
        correlation = torch.einsum("sd,scd->sc", path.atoms[rows, slot], error)
        fall = 2.0 * step * correlation - step * step  # [s, C]
        stepped = step * (fall > 0.0)
        penalty = (fall.clamp(min=0.0).sum(1) - slack) / stepped.sum(1).clamp(min=LEAST_DENOMINATOR)
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
        """Slots `[s]` of the lobes that correlate best with `error [s, C, D]`, filled if new."""
        model, coordinates = self._search(rows, error)
        lobes = self.grid.decode(model.reshape(-1), coordinates)
        values = self.grid.eval(lobes)  # [s C, D]
        values = values / values.norm(dim=1, keepdim=True).clamp(min=LEAST_DENOMINATOR)
        values = values.view_as(error)
        # Channels are searched apart; that of the best correlation gives the lobe [WDR11 §3.2].
        match = (values * error).sum(2) / error.norm(dim=2).clamp(min=LEAST_DENOMINATOR)
        channel = match.argmax(1)  # [s]
        atom = _at(values, channel)  # [s, D]
        nearest, slot = torch.einsum("smd,sd->sm", path.atoms[rows], atom).max(1)
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
        """The lobe of Eq. 5 of every sample and channel: (model `[s, C]`, coordinates `[s C, P]`).

        Each model starts from its best bank lobe. Models are compared on all direction pairs.
        """
        signals = error.flatten(0, 1)  # [s C, D]
        score = self.bank.atoms @ signals.T  # [A, s C]
        best_model = signals.new_zeros(len(signals), dtype=torch.long)
        best_value = torch.full((len(signals),), -torch.inf, device=signals.device)
        best = torch.zeros(len(signals), COORDINATES, device=signals.device)
        for index, own in self.bank.by_model:
            start = self.bank.coordinates[own[score[own].argmax(0)]]  # [s C, P]
            model = torch.full_like(best_model, index)
            found = self._climb(model, start, rows, error)
            value = self._correlation(model, found, signals)
            kept = self._correlation(model, start, signals)  # better if the drawn pairs mislead
            found = torch.where((value >= kept)[:, None], found, start)
            value = torch.where(value >= kept, value, kept)  # False for NaN
            better = value > best_value
            best_value = torch.where(better, value, best_value)
            best = torch.where(better[:, None], found, best)
            best_model = torch.where(better, index, best_model)
        return best_model.view(error.shape[:2]), best

    def _correlation(self, model: Tensor, coordinates: Tensor, signals: Tensor) -> Tensor:
        """<rho, mu> / ||rho|| on all pairs, `[R]`: Eq. 5 but for the norm of the signal mu."""
        rho = self.grid.eval(self.grid.decode(model, coordinates))
        return (rho * signals).sum(1) / rho.norm(dim=1).clamp(min=LEAST_DENOMINATOR)

    def _climb(self, model: Tensor, start: Tensor, rows: Tensor, error: Tensor) -> Tensor:
        """Coordinates `[R, P]` optimized row by row on the drawn pairs: Adam, then L-BFGS."""
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
            project = _Projection(self.feasible, model[chunk])
            climbed = minimize_adam(
                problem,
                start[chunk],
                project,
                steps=self.config.adam_steps,
                learning_rate=LEARNING_RATE,
            )
            result = minimize_lbfgs(problem, climbed.x, project, iterations=self.config.lbfgs_steps)
            self.counts.add_starts({Solver.ADAM: climbed.status, Solver.LBFGS: result.status})
            parts.append(_or_start(result, start[chunk]))
        return torch.cat(parts)


@dataclass(frozen=True)
class _Projection:
    """Projection of coordinates `[R, P]` of lobes of `model [R]` on the bounds."""

    feasible: Feasible
    model: Tensor

    def __call__(self, coordinates: Tensor) -> Tensor:
        return self.feasible.project(self.model, coordinates)


@dataclass(frozen=True)
class _Correlation:
    """Minus the objective of Eq. 5 of R rows, each on its own N pairs, and its gradient.

    Attributes:
        model: `[R]`.
        pairs, importance: `[R, N]`.
        target: residual of the signal on these pairs, times importance, `[R, N]`.
    """

    grid: DirectionGrid
    model: Tensor
    pairs: Tensor
    importance: Tensor
    target: Tensor

    def __call__(self, coordinates: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            x = coordinates.detach().requires_grad_()
            rho = self.grid.eval_at(self.grid.decode(self.model, x), self.pairs) * self.importance
            norm = (rho.square().sum(1) + ROOT_RIDGE).sqrt()
            size = self.target.norm(dim=1).clamp(min=LEAST_DENOMINATOR)
            value = -(rho * self.target).sum(1) / (norm * size)  # Eq. (5)
            (gradient,) = torch.autograd.grad(value.sum(), x)
        return value.detach(), gradient


def _gone(path: _Path, first: Tensor, end: Tensor) -> Tensor:
    """The share of their way to the last penalty that the paths have gone, `[S]`.

    Args:
        path: of the samples.
        first, end: first and last penalty of each, `[S]`; the first is infinite before a step.
    """
    share = (first - path.penalty) / (first - end).clamp(min=LEAST_DENOMINATOR)
    return torch.where(path.running, share.nan_to_num(0.0).clamp(0.0, 1.0), 1.0)


def _probability(signals: Tensor) -> Tensor:
    """Probability `[S, D]` of drawing a pair for signals `[S, C, D]`.

    Uniform draws alone would miss the specular peaks.
    """
    energy = signals.square().sum(1)  # [S, D]
    by_energy = energy / energy.sum(1, keepdim=True).clamp(min=LEAST_DENOMINATOR)
    return UNIFORM_FRACTION / energy.shape[1] + (1.0 - UNIFORM_FRACTION) * by_energy


def _at(values: Tensor, index: Tensor) -> Tensor:
    """`values[s, index[s]]` of `values [S, N, ...]`."""
    return values[torch.arange(len(index), device=values.device), index]


def _or_start(result: OptimizeResult, start: Tensor) -> Tensor:
    """The optimum of each row, or `start [R, P]` where the optimizer met NaN or infinity."""
    return torch.where((result.status == Status.NOT_FINITE)[:, None], start, result.x)
