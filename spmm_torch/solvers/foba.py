"""FoBa: forward selection and backward elimination of atoms, on a support shared by channels.

Every step ends in a non-negative least-squares refit of all channels on the support, where the
stagewise Lasso moves one weight by eta. The stopping rule is relative to the error of each texel.
Elimination follows the whole forward path, where [Zha11] has it after every forward step.

References:
    [Zha11] Tong Zhang, Adaptive Forward-Backward Greedy Algorithm for Learning Sparse
        Representations, IEEE Transactions on Information Theory 57(7), 2011.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..runtime.memory import slices
from .nnls import nnls_shared_gram
from .status import STATUS_DTYPE, Status

# Decreases under this fraction of the energy are float32 rounding of the correlations (60 dB).
LEAST_DECREASE = 1e-6
# Relative ridge of the elimination bound: keeps the inverse finite for duplicated atoms.
BOUND_RIDGE = 1e-10
# Rounds of forward selection per slot: a slot emptied by the refit can be filled once more.
ROUNDS_PER_SLOT = 2
# Rounds on a GPU after each of which texels that have stopped are left out: the host waits to know
# them.
CUDA_ROUNDS = 2
# Entries of the Gram rows that are gathered at once, for the slots of some texels: 8 MB, on a GPU
# 4 GB, enough for all texels.
CPU_ROW_ENTRIES, CUDA_ROW_ENTRIES = 1 << 21, 1 << 30


@dataclass(frozen=True)
class Selection:
    """Sparse non-negative combination of each texel.

    Attributes:
        index: atoms in the order of selection, `[T, M]` long, -1 for padding.
        weights: `[T, M, C]`, non-negative, zero for padding.
        error: ||y - D x||^2 of all channels, `[T]`.
        status: `[T]` int8. CONVERGED: no further atom decreases the error enough. LIMIT: of atoms,
            or of rounds. NOT_FINITE: of a correlation or an error; the atoms before that stay.
        nnls_status: of the refit that gave the weights, `[T, C]` int8.
    """

    index: Tensor
    weights: Tensor
    error: Tensor
    status: Tensor
    nnls_status: Tensor


@dataclass(frozen=True)
class _Texels:
    """Inputs, channels first, and the stopping rule; T' of the T texels still run."""

    gram: Tensor  # [L, J, J]
    owner: Tensor  # [T], the Gram matrix of each
    correlation: Tensor  # [T, C, J]
    energy: Tensor  # [T] float64
    min_gain: float | Tensor  # [T] where it varies
    floor: float
    inverse: Tensor  # of the diagonals of the Gram matrices, 0 where these are, [L, J]
    rows: Tensor  # [T'], indices of texels

    def take(self, rows: Tensor) -> _Texels:
        """Some of the texels that still run, by their positions `rows` among the T'."""
        return replace(self, rows=self.rows[rows])

    def inverses(self, part: slice) -> Tensor:
        """Inverse squared norms of the atoms of some of these texels, `[1 or t, J]`."""
        return self.inverse if len(self.inverse) == 1 else self.inverse[self.owner[self.rows[part]]]

    def lines(self, part: slice, place: Tensor) -> Tensor:
        """Lines of the Gram matrices of some of these texels, by atoms `[t, m]`: `[t, m, J]`."""
        count, atoms = self.gram.shape[:2]
        flat = place if count == 1 else place + atoms * self.owner[self.rows[part], None]
        return self.gram.flatten(0, 1).index_select(0, flat.flatten()).view(*place.shape, atoms)

    def among(self, place: Tensor) -> Tensor:
        """The Gram matrices of atoms `[T', m]` of the texels that run, `[T', m, m]`."""
        if len(self.gram) == 1:
            return self.gram[0][place[:, :, None], place[:, None, :]]
        return self.gram[self.owner[self.rows, None, None], place[:, :, None], place[:, None, :]]

    def least_gain(self, error: Tensor) -> Tensor:
        """Least decrease `[T']` for which an atom enters, given the error `[T']` without it."""
        gain = self.min_gain
        gain = gain[self.rows] if isinstance(gain, Tensor) else gain
        return torch.maximum(gain * error, self.floor * self.energy[self.rows])


@dataclass
class _Support:
    """Current solution; a slot with index -1 is free."""

    index: Tensor  # [T, M] long
    weights: Tensor  # [T, C, M] float64
    error: Tensor  # [T] float64
    status: Tensor  # [T, C] int8, of the last refit

    def take(self, rows: Tensor) -> _Support:
        return _Support(self.index[rows], self.weights[rows], self.error[rows], self.status[rows])

    def where(self, taken: Tensor, other: _Support) -> _Support:
        """This support in the texels `taken [T]` bool, the other one, as wide, elsewhere."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Support(
            *(torch.where(taken.view(-1, *[1] * (a.dim() - 1)), a, b) for a, b in pairs)
        )

    def packed(self, slots: int) -> _Support:
        """The same with atoms first, in `slots` columns, which must be enough."""
        order = (self.index < 0).to(torch.uint8).argsort(dim=1, stable=True)[:, :slots]
        channels = self.weights.shape[1]
        weights = self.weights.gather(2, order[:, None].expand(-1, channels, -1))
        index = self.index.gather(1, order)
        return _Support(index, weights, self.error, self.status).widened(slots)

    def widened(self, slots: int) -> _Support:
        """The same with free slots behind, `slots` in all."""
        more = slots - self.index.shape[1]
        if more <= 0:
            return self
        pad = torch.nn.functional.pad
        index, weights = pad(self.index, (0, more), value=-1), pad(self.weights, (0, more))
        return _Support(index, weights, self.error, self.status)

    def put(self, rows: Tensor, other: _Support) -> None:
        """Overwrites the texels `rows` in place."""
        self.index[rows], self.weights[rows] = other.index, other.weights
        self.error[rows], self.status[rows] = other.error, other.status

    def with_rows(self, rows: Tensor, other: _Support) -> _Support:
        """The same, as wide as the other one, with that in the texels `rows`."""
        wide = self.widened(other.index.shape[1])
        if len(rows) and other is not self:
            wide.put(rows, other)
        return wide

    def most(self) -> int:
        """Atoms of the texel that has most."""
        return int((self.index >= 0).sum(1).max()) if self.index.numel() else 0


def select_foba(
    gram: Tensor,
    correlation: Tensor,
    energy: Tensor,
    *,
    max_lobes: int | None,
    min_gain: float | Tensor,
    floor: float = LEAST_DECREASE,
    owner: Tensor | None = None,
) -> Selection:
    """Chooses up to `max_lobes` atoms for each texel, shared by its channels [Zha11].

    Forward: the atom of largest guaranteed decrease sum_c max(g_jc, 0)^2 / G_jj enters, where
    g = D^T (y - D x), and all channels are refit by NNLS. A texel stops when the decrease of its
    error is not above `min_gain` times the error before, nor above `floor` times the energy.
    Backward: the atom whose removal raises the error least leaves, while the raise after the refit
    is within the same limit.

    Args:
        gram: D^T D `[J, J]`, or `[L, J, J]` of several D; atoms need not have unit norm.
        correlation: D^T y `[T, J, C]`.
        energy: ||y||^2 of all channels, `[T]`.
        max_lobes: most atoms of one texel, M; None: any number, M is the largest that occurs.
        min_gain: least relative decrease of the error for which an atom enters, in [0, 1]; `[T]`
            float64 where it varies.
        floor: least decrease relative to the energy.
        owner: which of several Gram matrices is that of each texel, `[T]`; None: there is one.

    Returns:
        Atoms, weights and remaining error of each texel in the dtype of `correlation`, and how
        each texel ended.
    """
    count, atoms, channels = correlation.shape
    energy = energy.double()
    by_channel = correlation.transpose(1, 2).contiguous()  # [T, C, J]
    everywhere = torch.arange(count, device=gram.device)
    owner = torch.zeros_like(everywhere) if owner is None else owner
    grams = gram.to(correlation.dtype)
    grams = grams[None] if grams.dim() == 2 else grams
    norm = grams.diagonal(dim1=1, dim2=2)
    inverse = torch.where(norm > 0, 1.0 / norm, 0.0)
    given = grams, owner, by_channel, energy, min_gain, floor, inverse
    texels = _Texels(*given, everywhere)
    support, status = _select_forward(texels, atoms if max_lobes is None else max_lobes)
    support = support.packed(support.most())
    _eliminate_backward(texels, support)
    support = support.packed(support.most() if max_lobes is None else max_lobes)
    return Selection(
        support.index,
        support.weights.transpose(1, 2).to(correlation.dtype),
        support.error.to(correlation.dtype),
        status,
        support.status,
    )


def _select_forward(texels: _Texels, slots: int) -> tuple[_Support, Tensor]:
    """Adds atoms until every texel has stopped: support, and how each texel ended `[T]`.

    The support is as wide as the rounds that this took.
    """
    count, channels, atoms = texels.correlation.shape
    status = torch.full_like(texels.rows, Status.CONVERGED, dtype=STATUS_DTYPE)
    support = _Support(
        texels.rows.new_zeros(count, 0),
        texels.energy.new_zeros(count, channels, 0),
        texels.energy.clone(),
        status[:, None].repeat(1, channels),
    )
    running, current = torch.ones_like(status, dtype=torch.bool), support  # [T']
    rounds = CUDA_ROUNDS if running.is_cuda else 1
    for step in range(ROUNDS_PER_SLOT * slots if atoms else 0):
        if not texels.rows.numel():
            break
        # Free slots are filled from the front, so that the first rounds solve smaller systems.
        current = current.widened(min(step + 1, slots))
        trial, best = _add_atom(texels, current)
        gain = current.error - trial.error  # [T']
        total = best + gain
        _mark(status, texels.rows, running & ((total - total) != 0.0), Status.NOT_FINITE)
        running &= (best > 0) & (gain > texels.least_gain(current.error))
        dead = (trial.weights == 0).all(1)  # [T', m]: atoms without weight after the refit
        trial.index.masked_fill_(dead, -1)
        current = trial.where(running, current)
        if current.index.shape[1] == slots:
            full = running & (trial.index >= 0).all(-1)
            if slots < atoms:
                _mark(status, texels.rows, full, Status.LIMIT)
            running &= ~full
        if (step + 1) % rounds == 0:
            left = running.nonzero()[:, 0]
            support = support.with_rows(texels.rows, current)
            texels, running, current = texels.take(left), running[left], current.take(left)
    if atoms:
        _mark(status, texels.rows, running, Status.LIMIT)
    return support.with_rows(texels.rows, current), status


def _mark(status: Tensor, rows: Tensor, ended: Tensor, how: Status) -> None:
    """Sets the `status [T]` of texels `rows [T']` where they have `ended [T']`."""
    status[rows] = torch.where(ended, int(how), status[rows])


def _add_atom(texels: _Texels, current: _Support) -> tuple[_Support, Tensor]:
    """Support with the best atom in its first free slot, refit; guaranteed decrease `[T']`.

    Where that is not positive no atom enters.
    """
    index, weights = current.index, current.weights
    best, atom = _best_atoms(texels, current)
    is_free = index < 0
    slot = is_free.to(torch.uint8).argmax(-1, keepdim=True)  # [T', 1], the first free one
    entering = torch.zeros_like(is_free).scatter_(1, slot, (best > 0)[:, None])
    index = torch.where(entering, atom[:, None], index)
    return _refit(texels, index, (weights > 0) | entering[:, None]), best


def _best_atoms(texels: _Texels, current: _Support) -> tuple[Tensor, Tensor]:
    """Guaranteed decrease `[T']` by the best atom `[T']` that is not in the support."""
    slots, atoms = current.index.shape[1], texels.gram.shape[1]
    parts: list[tuple[Tensor, Tensor]] = []
    entries = CUDA_ROW_ENTRIES if texels.gram.is_cuda else CPU_ROW_ENTRIES
    for part in slices(len(current.index), max(1, entries // (slots * atoms))):
        place = current.index[part].clamp_min(0)  # [t, m]; free slots have no weight
        lines = texels.lines(part, place)
        weights = current.weights[part].to(lines.dtype)  # [t, C, m]
        residual = texels.correlation.index_select(0, texels.rows[part])  # D^T y, [t, C, J]
        residual.baddbmm_(weights, lines, alpha=-1)  # D^T (y - D x)
        score = residual.clamp_(min=0).square_().sum(1) * texels.inverses(part)  # [t, J]
        # The first atom stands for the free slots: it is put back unless it is in the support.
        first = score[:, 0].masked_fill((current.index[part] == 0).any(1), 0.0)
        score.scatter_(1, place, 0.0)
        score[:, 0] = first
        best, atom = score.max(-1)
        parts.append((best, atom))
    if len(parts) == 1:
        return parts[0]
    return torch.cat([best for best, _ in parts]), torch.cat([atom for _, atom in parts])


def _refit(texels: _Texels, index: Tensor, guess: Tensor) -> _Support:
    """NNLS of every channel on the support `[T', m]`, starting from the passive set `guess`."""
    place = index.clamp_min(0)
    gram = texels.among(place).double()  # [T', m, m]
    channel = torch.arange(guess.shape[1], device=place.device)[:, None]
    rhs = texels.correlation[texels.rows[:, None, None], channel, place[:, None]].double()
    refit = nnls_shared_gram(gram, rhs, allowed=index >= 0, guess=guess)
    weights = refit.weights  # [T', C, m]
    error = texels.energy[texels.rows] + (weights * (weights @ gram).sub_(rhs, alpha=2)).sum((1, 2))
    return _Support(index, weights, error.clamp_min(0), refit.status)


def _eliminate_backward(texels: _Texels, support: _Support) -> None:
    """Drops atoms, in place, while the raise of the error is within the limit.

    Each round refits without the atom of least lower bound on the raise, in the texels where that
    bound is within the limit.
    """
    used = support.index.shape[1]
    open_ = torch.ones_like(texels.rows, dtype=torch.bool)  # [T']
    for _ in range(used):
        current = support.take(texels.rows).packed(used)
        before = current.error  # [T']
        bound, slot = _raise_bound(texels, current).min(1)  # [T'], inf at free slots
        hopeful = (open_ & (bound <= texels.least_gain(before + bound))).nonzero()[:, 0]
        if not hopeful.numel():
            break
        texels, current, before = texels.take(hopeful), current.take(hopeful), before[hopeful]
        removed = torch.zeros_like(current.index, dtype=torch.bool)
        removed.scatter_(1, slot[hopeful, None], True)  # [T', M]
        guess = (current.weights > 0) & ~removed[:, None]
        trial = _refit(texels, current.index.masked_fill(removed, -1), guess)
        raised = trial.error - before
        open_ = raised <= texels.least_gain(trial.error)
        support.put(texels.rows, trial.where(open_, current))


def _raise_bound(texels: _Texels, current: _Support) -> Tensor:
    """Lower bound of the raise of the error when an atom is removed, `[T, M]`.

    At an optimum x, any feasible x' has f(x') - f(x) >= (x' - x)^T G (x' - x), whose least value
    with x'_i = 0 is x_i^2 / (G^-1)_ii over the support.
    """
    member = current.index >= 0  # [T, M]
    place = current.index.clamp_min(0)
    both = member[:, :, None] & member[:, None, :]
    matrix = torch.where(both, texels.among(place).double(), 0.0)
    norm = matrix.diagonal(dim1=1, dim2=2).clone()  # [T, M]
    matrix.diagonal(dim1=-2, dim2=-1).copy_(torch.where(member, norm * (1 + BOUND_RIDGE), 1.0))
    factor, info = torch.linalg.cholesky_ex(matrix)
    inverse = torch.cholesky_inverse(factor).diagonal(dim1=-2, dim2=-1)  # [T, M]
    bound = current.weights.square().sum(1) / inverse
    bound = torch.where((info == 0)[:, None], bound, 0.0)
    return torch.where(member, bound, torch.inf)
