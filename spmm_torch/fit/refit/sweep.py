"""One turn of alternating least squares: functions of the residual for given coefficients.

A pair of directions tells its own value of every function, apart from all other pairs. So the pass
that fits the functions of a view also gives their products with the pictures of that view, from
which the next coefficients follow. What the lobes show need not be drawn for it: its products with
R columns take a fifth of the work.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ...data import BTF
from ...model.lookup import SparseWeights
from ...runtime.ranks import Ranks
from ...runtime.sparse import sparse_product
from .lookups import Lookups
from .matrices import (
    by_channel,
    columns_by_view,
    joint_matrix,
    rows_by_view,
    solve_with_ridge,
    transposed,
)
from .pictures import pictures_of

# Ridge relative to the mean diagonal: views that show little leave functions undetermined.
RIDGE = 1e-4


@dataclass(frozen=True)
class Swept:
    """Functions of least error for some coefficients.

    Attributes:
        functions: without the weights of pairs, `[V, R, L, C]`.
        products: sum_v < B_r(v, .), (W_v^T E_v)[q, .] > with what the lobes leave, with the weights
            of pairs, `[T, R]` float64.
    """

    functions: Tensor
    products: Tensor

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `functions [V, R, L, C]` and `products [T, R]`."""
        return dict(vars(self))

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Swept:
        """The functions of a checkpoint; see `Swept.to_tensors`."""
        return cls(**tensors)

    def to(self, device: torch.device) -> Swept:
        """The same on another device: what a checkpoint held is on the CPU."""
        return Swept(self.functions.to(device), self.products.to(device))


def sweep(
    pictures: BTF,
    scale: Tensor | None,
    lookups: Lookups,
    entries: SparseWeights,
    rho: Tensor,
    coefficient: Tensor,
    ranks: Ranks,
    advance: Callable[[int], object],
    *,
    exact: bool,
    kept: Tensor | None = None,
) -> Swept:
    """Reads all pictures once; every rank has a part of the views.

    Args:
        pictures: as they were measured.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
        lookups: what each pixel shows, with the weights of pixels.
        entries: fit of all texels.
        rho: values of the lobes without weights of pairs, `[V, J, L]`.
        coefficient: c, `[T, R]`.
        ranks: processes among which the views are divided.
        advance: called with the number of views done.
        exact: whether what the lobes leave is drawn; by products alone, which takes a third of the
            time, it is right to the rounding of the pictures.
        kept: share of the functions to keep at each pair, `[V, L]`; None: 1.
    """
    device, rank = rho.device, coefficient.shape[1]
    lights, channels = len(pictures.light), pictures.channels
    functions = torch.zeros(lookups.views, rank, lights, channels, device=device)
    products = torch.zeros(coefficient.shape, dtype=torch.float64, device=device)
    lobes = _Lobes.of(entries, rho)

    def of_run(run: slice) -> tuple[Tensor, Tensor]:
        """(functions, products) of a run, whose pictures are freed before the next ones come."""
        left = pictures_of(pictures, run, lookups, device)  # [n, T, L C]
        if exact:
            left = left - lobes.drawn(lookups, run, channels).view_as(left)
        rows = sparse_product(lookups.drawn(run), coefficient)
        seen = rows.view(-1, *coefficient.shape)  # [n, T, R]
        across = seen.transpose(1, 2)
        rhs = across @ left
        if not exact:  # with S = W_v c and lobes J: S^T (Y - W_v J) = S^T Y - (W_v^T S)^T J
            rhs -= lobes.shown_by(sparse_product(lookups.gathered(run, apart=True), rows), run)
        found = solve_with_ridge(across @ seen, rhs, RIDGE).unflatten(2, (lights, channels))
        if kept is not None:
            found = found * kept[run][:, None, :, None]
        along = found if scale is None else found * scale.view(-1, 1, lights, 1)[run].square()
        shown = (left @ along.flatten(2).transpose(1, 2)).flatten(0, 1)  # [n T, R]
        if not exact:
            shown -= sparse_product(lookups.drawn(run, apart=True), lobes.along(along, run))
        return found, sparse_product(lookups.gathered(run), shown)

    for run in lookups.runs(*ranks.span(lookups.views)):
        functions[run], shown = of_run(run)
        products += shown
        advance(ranks.size * (run.stop - run.start))
    return Swept(ranks.sum(functions), ranks.sum(products))


@dataclass(frozen=True)
class _Lobes:
    """What the lobes of all texels show, and its products with functions of few columns.

    Attributes:
        weight: of the texels, sparse CSR `[T, J C]`.
        transposed: the same, `[J C, T]`.
        rho: values of the lobes, `[V, J, L]`.
    """

    weight: Tensor
    transposed: Tensor
    rho: Tensor

    @classmethod
    def of(cls, entries: SparseWeights, rho: Tensor) -> _Lobes:
        weight = joint_matrix(entries, rho.shape[1])
        return cls(weight, transposed(weight), rho)

    def drawn(self, lookups: Lookups, run: slice, channels: int) -> Tensor:
        """What pixels show `[n T, L C]`."""
        values = sparse_product(self.weight, by_channel(self.rho[run], channels).T)  # [T, n L C]
        return sparse_product(lookups.drawn(run, apart=True), rows_by_view(values, run))

    def shown_by(self, columns: Tensor, run: slice) -> Tensor:
        """Products `[n, R, L C]` of rows of texels `[n T, R]` with what the lobes show there."""
        joint = sparse_product(self.transposed, columns_by_view(columns, run))  # [J C, n R]
        views, lobes = run.stop - run.start, self.rho.shape[1]
        joint = joint.view(lobes, -1, views, columns.shape[1])
        return torch.einsum("jcnr,njl->nrlc", joint, self.rho[run]).flatten(2)

    def along(self, functions: Tensor, run: slice) -> Tensor:
        """Products `[n T, R]` of what lobes show at each texel with functions `[n, R, L, C]`."""
        joint = torch.einsum("njl,nrlc->jcnr", self.rho[run], functions)
        return rows_by_view(sparse_product(self.weight, joint.flatten(2).flatten(0, 1)), run)
