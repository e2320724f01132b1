"""Fully corrective forward selection and backward elimination on a support shared by channels.

The finite-dictionary fit with a refit after every step: where the stagewise Lasso creeps along its
path in steps of eta, this takes an atom, solves the non-negative least squares of every channel on
the support, and goes on with the true residual. The stopping rule is relative, per texel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..runtime.memory import slices
from .nnls import nnls_channels

# Decreases under this fraction of the energy are float32 rounding of the correlations (60 dB).
ENERGY_FLOOR = 1e-6
# Relative ridge of the elimination bound: keeps the inverse finite for duplicated atoms.
BOUND_RIDGE = 1e-10
# Rounds of forward selection per slot: a slot emptied by the refit can be filled once more.
ROUNDS_PER_SLOT = 2
# Rows of the Gram matrix that are picked out at once, for the slots of some texels: 8 MB.
SLOPE_ENTRIES = 1 << 21


@dataclass(frozen=True)
class Selection:
    """Sparse non-negative combination of each texel."""

    index: Tensor  # [T, M] long, atoms in order of selection, padded with -1
    weights: Tensor  # [T, M, C], >= 0, zero where padded
    error: Tensor  # [T], ||y - D x||^2 of all channels


@dataclass(frozen=True)
class _Texels:
    """Inputs, channels first, with the stopping rule; T' of the T texels are looked at."""

    gram: Tensor  # [J, J]
    correlation: Tensor  # [T, C, J]
    energy: Tensor  # [T] float64
    min_gain: float | Tensor  # [T] where it varies
    floor: float
    rows: Tensor  # [T'], indices of texels

    def take(self, rows: Tensor) -> _Texels:
        """Some of those that are looked at."""
        return replace(self, rows=self.rows[rows])

    def least_gain(self, error: Tensor) -> Tensor:
        """Smallest decrease worth a lobe, given the summed error `[T']` without it."""
        gain = self.min_gain
        gain = gain[self.rows] if isinstance(gain, Tensor) else gain
        return torch.maximum(gain * error, self.floor * self.energy[self.rows])


@dataclass
class _Support:
    """Current solution; a slot with index -1 is free."""

    index: Tensor  # [T, M] long
    weights: Tensor  # [T, C, M] float64
    error: Tensor  # [T] float64

    def take(self, rows: Tensor) -> _Support:
        return _Support(self.index[rows], self.weights[rows], self.error[rows])

    def packed(self, slots: int) -> _Support:
        """The same with lobes first, in `slots` columns, which must be enough."""
        order = (self.index < 0).to(torch.uint8).argsort(dim=1, stable=True)[:, :slots]
        channels = self.weights.shape[1]
        weights = self.weights.gather(2, order[:, None].expand(-1, channels, -1))
        return _Support(self.index.gather(1, order), weights, self.error).widened(slots)

    def widened(self, slots: int) -> _Support:
        """The same with free slots behind, `slots` in all."""
        more = slots - self.index.shape[1]
        if more <= 0:
            return self
        pad = torch.nn.functional.pad
        return _Support(
            pad(self.index, (0, more), value=-1), pad(self.weights, (0, more)), self.error
        )

    def put(self, rows: Tensor, other: _Support) -> None:
        self.index[rows], self.weights[rows] = other.index, other.weights
        self.error[rows] = other.error

    def most(self) -> int:
        """Lobes of the texel that has most."""
        return int((self.index >= 0).sum(1).max()) if self.index.numel() else 0


def select_corrective(
    gram: Tensor,
    correlation: Tensor,
    energy: Tensor,
    *,
    max_lobes: int | None,
    min_gain: float | Tensor,
    floor: float = ENERGY_FLOOR,
) -> Selection:
    """Chooses up to `max_lobes` atoms a texel, shared by its channels, and their weights.

    Forward: the atom of largest guaranteed decrease sum_c max(g_jc, 0)^2 / G_jj enters, all
    channels are refit by NNLS, and the texel stops when the decrease of the summed error is not
    above `min_gain` times the error before it, nor above `floor` times the energy. Backward: the
    lobe whose removal raises the error least leaves, as long as that raise, after the refit, is
    within the same limit.

    Args:
        gram: D^T D `[J, J]`; atoms need not have unit norm.
        correlation: D^T y `[T, J, C]`.
        energy: ||y||^2 of all channels, `[T]`.
        max_lobes: most atoms of one texel, M; None: any number, M is the largest that occurs.
        min_gain: least relative decrease of the error that is worth one lobe, in [0, 1]; `[T]`
            float64 where it varies.
        floor: least decrease relative to the energy.

    Returns:
        Atoms, weights and remaining error of each texel, dtype of `correlation`.
    """
    count, atoms, channels = correlation.shape
    energy = energy.double()
    by_channel = correlation.transpose(1, 2).contiguous()  # [T, C, J]
    everywhere = torch.arange(count, device=gram.device)
    texels = _Texels(gram.to(correlation.dtype), by_channel, energy, min_gain, floor, everywhere)
    support = _select_forward(texels, atoms if max_lobes is None else max_lobes)
    support = support.packed(support.most())
    _eliminate_backward(texels, support)
    support = support.packed(support.most() if max_lobes is None else max_lobes)
    return Selection(
        support.index,
        support.weights.transpose(1, 2).to(correlation.dtype),
        support.error.to(correlation.dtype),
    )


def _select_forward(texels: _Texels, slots: int) -> _Support:
    """Adds atoms until every texel has stopped; as wide as the rounds that this took."""
    count, channels, _ = texels.correlation.shape
    support = _Support(
        texels.rows.new_zeros(count, 0),
        texels.energy.new_zeros(count, channels, 0),
        texels.energy.clone(),
    )
    for step in range(ROUNDS_PER_SLOT * slots):
        if not texels.rows.numel():
            break
        # Free slots are filled from the front, so that the first rounds solve smaller systems.
        support = support.widened(min(step + 1, slots))
        current = support.take(texels.rows)
        trial, possible = _add_atom(texels, current)
        gain = current.error - trial.error  # [T']
        kept = (possible & (gain > texels.least_gain(current.error))).nonzero()[:, 0]
        texels, trial = texels.take(kept), trial.take(kept)
        dead = (trial.weights == 0).all(1)  # [T', m]: lobes that the refit made useless
        trial.index.masked_fill_(dead, -1)
        support.put(texels.rows, trial)
        if support.index.shape[1] == slots:
            texels = texels.take((trial.index < 0).any(-1).nonzero()[:, 0])
    return support


def _add_atom(texels: _Texels, current: _Support) -> tuple[_Support, Tensor]:
    """Support with the best new atom, refit, and where one exists `[T]`."""
    index, weights = current.index, current.weights
    best, atom = _best_atoms(texels, current)
    is_free = index < 0
    slot = is_free.to(torch.uint8).argmax(-1, keepdim=True)  # [T, 1], the first free one
    possible = (best > 0) & is_free.any(-1)
    entering = torch.zeros_like(is_free).scatter_(1, slot, possible[:, None])
    index = torch.where(entering, atom[:, None], index)
    return _refit(texels, index, (weights > 0) | entering[:, None]), possible


def _best_atoms(texels: _Texels, current: _Support) -> tuple[Tensor, Tensor]:
    """Guaranteed decrease `[T]` by the best atom `[T]` that is not in the support."""
    slots, atoms = current.index.shape[1], texels.gram.shape[0]
    norm = texels.gram.diagonal()  # [J]
    inverse = torch.where(norm > 0, 1.0 / norm, 0.0)
    parts = []
    for part in slices(len(current.index), max(1, SLOPE_ENTRIES // (slots * atoms))):
        place = current.index[part].clamp_min(0)  # [t, m]; free slots have no weight
        lines = texels.gram.index_select(0, place.flatten()).view(*place.shape, atoms)
        weights = current.weights[part].to(lines.dtype)  # [t, C, m]
        slope = texels.correlation.index_select(0, texels.rows[part])  # [t, C, J]
        slope.baddbmm_(weights, lines, alpha=-1)
        score = slope.clamp_(min=0).square_().sum(1) * inverse  # [t, J]
        # The first atom stands for the free slots: it is put back unless it is in the support.
        first = torch.where((current.index[part] == 0).any(1), 0.0, score[:, 0])
        score.scatter_(1, place, 0.0)
        score[:, 0] = first
        parts.append(score.max(-1))
    return tuple(torch.cat(column) for column in zip(*parts, strict=True))


def _refit(texels: _Texels, index: Tensor, guess: Tensor) -> _Support:
    """NNLS of every channel on the support `[T', m]`, starting from the passive set `guess`."""
    place = index.clamp_min(0)
    gram = texels.gram[place[:, :, None], place[:, None, :]].double()  # [T', m, m]
    channel = torch.arange(guess.shape[1], device=place.device)[:, None]
    rhs = texels.correlation[texels.rows[:, None, None], channel, place[:, None]].double()
    weights = nnls_channels(gram, rhs, allowed=index >= 0, guess=guess)  # [T', C, m]
    error = texels.energy[texels.rows] + (weights * (weights @ gram - 2 * rhs)).sum((1, 2))
    return _Support(index, weights, error.clamp_min(0))


def _eliminate_backward(texels: _Texels, support: _Support) -> None:
    """Drops lobes, in place, while the raise of the error is within the limit.

    Each round refits without the lobe of least lower bound on the raise, in the texels where that
    bound is within the limit.
    """
    used = support.index.shape[1]
    for _ in range(used):
        current = support.take(texels.rows).packed(used)
        before = current.error  # [T']
        bound, slot = _raise_bound(texels.gram, current).min(1)  # [T'], inf at free slots
        hopeful = (bound <= texels.least_gain(before + bound)).nonzero()[:, 0]
        if not hopeful.numel():
            break
        texels, current, before = texels.take(hopeful), current.take(hopeful), before[hopeful]
        removed = torch.zeros_like(current.index, dtype=torch.bool)
        removed.scatter_(1, slot[hopeful, None], True)  # [T', M]
        guess = (current.weights > 0) & ~removed[:, None]
        trial = _refit(texels, current.index.masked_fill(removed, -1), guess)
        raised = trial.error - before
        dropped = (raised <= texels.least_gain(trial.error)).nonzero()[:, 0]
        texels = texels.take(dropped)
        support.put(texels.rows, trial.take(dropped))


def _raise_bound(gram: Tensor, current: _Support) -> Tensor:
    """Lower bound of the rise of the summed error when a lobe is removed, `[T, M]`.

    At an optimum x, any feasible x' has f(x') - f(x) >= (x' - x)^T G (x' - x), whose least value
    with x'_i = 0 is x_i^2 / (G^-1)_ii over the support.
    """
    member = current.index >= 0  # [T, M]
    place = current.index.clamp_min(0)
    both = member[:, :, None] & member[:, None, :]
    matrix = torch.where(both, gram[place[:, :, None], place[:, None, :]].double(), 0.0)
    norm = gram.diagonal().double()[place]  # [T, M]
    matrix.diagonal(dim1=-2, dim2=-1).copy_(torch.where(member, norm * (1 + BOUND_RIDGE), 1.0))
    factor, info = torch.linalg.cholesky_ex(matrix)
    inverse = torch.cholesky_inverse(factor).diagonal(dim1=-2, dim2=-1)  # [T, M]
    bound = current.weights.square().sum(1) / inverse
    bound = torch.where((info == 0)[:, None], bound, 0.0)
    return torch.where(member, bound, torch.inf)
