"""Fully corrective forward selection and backward elimination on a support shared by channels.

The finite-dictionary fit with a refit after every step: where the stagewise Lasso creeps along its
path in steps of eta, this takes an atom, solves the non-negative least squares of every channel on
the support, and goes on with the true residual. The stopping rule is relative, per texel.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from spmm_torch.solvers.nnls import nnls_gram

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
    error: Tensor  # [T, C], ||y - D x||^2


@dataclass(frozen=True)
class _Texels:
    """Inputs, channels first, with the stopping rule."""

    gram: Tensor  # [J, J]
    correlation: Tensor  # [T, C, J]
    energy: Tensor  # [T, C] float64
    min_gain: float | Tensor  # [T] where it varies
    floor: float

    def take(self, rows: Tensor) -> _Texels:
        if len(rows) == len(self.correlation):  # all of them, in order
            return self
        min_gain = self.min_gain[rows] if isinstance(self.min_gain, Tensor) else self.min_gain
        return _Texels(self.gram, self.correlation[rows], self.energy[rows], min_gain, self.floor)

    def least_gain(self, error: Tensor) -> Tensor:
        """Smallest decrease worth a lobe, given the summed error `[T]` without it."""
        return torch.maximum(self.min_gain * error, self.floor * self.energy.sum(-1))


@dataclass
class _Support:
    """Current solution; a slot with index -1 is free."""

    index: Tensor  # [T, M] long
    weights: Tensor  # [T, C, M] float64
    error: Tensor  # [T, C] float64

    def take(self, rows: Tensor) -> _Support:
        return _Support(self.index[rows], self.weights[rows], self.error[rows])

    def packed(self, slots: int) -> _Support:
        """The same with lobes first, in `slots` columns, which must be enough."""
        order = (self.index < 0).to(torch.uint8).argsort(dim=1, stable=True)[:, :slots]
        channels = self.weights.shape[1]
        weights = self.weights.gather(2, order[:, None].expand(-1, channels, -1))
        return _Support(self.index.gather(1, order), weights, self.error)

    def put(self, rows: Tensor, other: _Support) -> None:
        slots = other.index.shape[1]
        self.index[rows, slots:], self.weights[rows, :, slots:] = -1, 0.0
        self.index[rows, :slots] = other.index
        self.weights[rows, :, :slots] = other.weights
        self.error[rows] = other.error


def select_corrective(
    gram: Tensor,
    correlation: Tensor,
    energy: Tensor,
    *,
    max_lobes: int,
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
        energy: ||y||^2 `[T, C]`.
        max_lobes: most atoms of one texel, M.
        min_gain: least relative decrease of the error that is worth one lobe, in [0, 1]; `[T]`
            float64 where it varies.
        floor: least decrease relative to the energy.

    Returns:
        Atoms, weights and remaining error of each texel, dtype of `correlation`.
    """
    count, _, channels = correlation.shape
    energy = energy.double()
    by_channel = correlation.transpose(1, 2).contiguous()  # [T, C, J]
    texels = _Texels(gram.to(correlation.dtype), by_channel, energy, min_gain, floor)
    support = _Support(
        torch.full((count, max_lobes), -1, dtype=torch.long, device=gram.device),
        torch.zeros(count, channels, max_lobes, dtype=torch.float64, device=gram.device),
        energy.clone(),
    )
    _select_forward(texels, support)
    _eliminate_backward(texels, support)
    support = support.packed(max_lobes)
    return Selection(
        support.index,
        support.weights.transpose(1, 2).to(correlation.dtype),
        support.error.to(correlation.dtype),
    )


def _select_forward(texels: _Texels, support: _Support) -> None:
    """Adds atoms, in place, until every texel has stopped."""
    slots = support.index.shape[1]
    rows = torch.arange(support.index.shape[0], device=support.index.device)
    for step in range(ROUNDS_PER_SLOT * slots):
        if not rows.numel():
            break
        current = support.take(rows)
        # Free slots are filled from the front, so that the first rounds solve smaller systems.
        used = min(step + 1, slots)
        current = _Support(current.index[:, :used], current.weights[..., :used], current.error)
        trial, possible = _add_atom(texels, current)
        before = current.error.sum(-1)  # [T']
        gain = before - trial.error.sum(-1)
        kept = (possible & (gain > texels.least_gain(before))).nonzero()[:, 0]
        texels, trial, rows = texels.take(kept), trial.take(kept), rows[kept]
        dead = (trial.weights == 0).all(1)  # [T', m]: lobes that the refit made useless
        trial.index.masked_fill_(dead, -1)
        support.put(rows, trial)
        free = (support.index[rows] < 0).any(-1).nonzero()[:, 0]
        texels, rows = texels.take(free), rows[free]


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
    for rows in torch.arange(len(current.index)).split(max(1, SLOPE_ENTRIES // (slots * atoms))):
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        place = current.index[part].clamp_min(0)  # [t, m]; free slots have no weight
        lines = texels.gram.index_select(0, place.flatten()).view(*place.shape, atoms)
        weights = current.weights[part].to(lines.dtype)  # [t, C, m]
        slope = torch.baddbmm(texels.correlation[part], weights, lines, alpha=-1)  # [t, C, J]
        score = slope.clamp_(min=0).square_().sum(1) * inverse  # [t, J]
        # The first atom stands for the free slots: it is put back unless it is in the support.
        first = torch.where((current.index[part] == 0).any(1), 0.0, score[:, 0])
        score.scatter_(1, place, 0.0)
        score[:, 0] = first
        parts.append(score.max(-1))
    return tuple(torch.cat(column) for column in zip(*parts, strict=True))


def _refit(texels: _Texels, index: Tensor, guess: Tensor) -> _Support:
    """NNLS of every channel on the support `[T, m]`, starting from the passive set `guess`."""
    place = index.clamp_min(0)
    gram = texels.gram[place[:, :, None], place[:, None, :]].double()[:, None]  # [T, 1, m, m]
    rhs = texels.correlation.gather(2, place[:, None].expand_as(guess)).double()  # [T, C, m]
    weights = nnls_gram(gram, rhs, allowed=(index >= 0)[:, None], guess=guess)
    product = (gram @ weights[..., None])[..., 0]
    error = texels.energy + (weights * (product - 2 * rhs)).sum(-1)  # [T, C]
    return _Support(index, weights, error.clamp_min(0))


def _eliminate_backward(texels: _Texels, support: _Support) -> None:
    """Drops lobes, in place, while the raise of the error is within the limit.

    Each round refits without the lobe of least lower bound on the raise, in the texels where that
    bound is within the limit.
    """
    used = int((support.index >= 0).sum(1).max()) if support.index.numel() else 0
    rows = torch.arange(support.index.shape[0], device=support.index.device)
    for _ in range(used):
        current = support.take(rows).packed(used)
        before = current.error.sum(-1)  # [T']
        bound, slot = _raise_bound(texels.gram, current).min(1)  # [T'], inf at free slots
        hopeful = (bound <= texels.take(rows).least_gain(before + bound)).nonzero()[:, 0]
        if not hopeful.numel():
            break
        rows, current, before = rows[hopeful], current.take(hopeful), before[hopeful]
        removed = torch.zeros_like(current.index, dtype=torch.bool)
        removed.scatter_(1, slot[hopeful, None], True)  # [T', M]
        here = texels.take(rows)
        guess = (current.weights > 0) & ~removed[:, None]
        trial = _refit(here, current.index.masked_fill(removed, -1), guess)
        after = trial.error.sum(-1)
        dropped = (after - before <= here.least_gain(after)).nonzero()[:, 0]
        rows = rows[dropped]
        support.put(rows, trial.take(dropped))


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
