"""The least-squares problem of the weights of all lobes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from ...metrics import Totals
from ...model.lookup import SparseWeights
from ...runtime.allocator import give_back_freed_memory
from ...runtime.sparse import sparse_product
from ...solvers.sparse_nnls import sparse_nnls
from ...solvers.status import Solver, StatusCounts
from .lookups import Lookups
from .normal import NormalMatrix
from .projections import Projections

# Largest loss by rounding to the stored type: less than any figure shows.
MAX_ROUNDING_DB = 0.02
# Largest violation of the optimality conditions of the weights, relative to the largest product.
TOLERANCE = 1e-4
# How much weights are held to what they are on aligned values, as a share of the energy of a lobe
# that all views show: one that is hidden in nearly all views would grow without bounds to follow a
# trace of it in the others, and stand out where none was measured.
HELD = 0.01
# Errors under this share of the energy are computed value by value: the algebra of float32
# products is right to some 1e-7 of the energy.
ROUNDING = 1e-4
# Share of the energy under which the algebra of products tells no loss, and weights stay as they
# are.
FAINT = 1e-6


@dataclass(frozen=True)
class System:
    """The least-squares problem of weights and coefficients, for one weighting of the errors.

    Attributes:
        lookups: what each pixel shows.
        normal: normal matrix of the entries.
        products: of the pictures.
        aligned: weights fit to aligned values, `[N, C]`.
        ridge: how much weights are held to these, `[N]`.
    """

    lookups: Lookups
    normal: NormalMatrix
    products: Projections
    aligned: Tensor
    ridge: Tensor

    def error(self, weight: Tensor) -> float:
        """Squared error of the lobes alone with weights `[N, C]`."""
        shown = sparse_product(self.normal.matrix, weight).double()
        value = (weight.double() * (shown - 2.0 * self.products.lobes)).sum()
        return max(self.products.energy + float(value), 0.0)

    def shown(self, weight: Tensor) -> float:
        """What the lobes with weights `[N, C]` show, squared; such as changes of weights."""
        return float((weight.double() * sparse_product(self.normal.matrix, weight).double()).sum())

    def fitted(
        self, entries: SparseWeights, rhs: Tensor, steps: int
    ) -> tuple[SparseWeights, StatusCounts]:
        """The weights of least error for products `rhs [N, C]`, and how their solver ended.

        Those that hardly show in any picture stay near what they are on aligned values.
        """
        give_back_freed_memory()
        solved = sparse_nnls(
            self.normal.matrix,
            self.normal.diagonal,
            rhs.float() + self.ridge[:, None] * self.aligned,
            entries.weight,
            ridge=self.ridge,
            steps=steps,
            tolerance=TOLERANCE,
        )
        give_back_freed_memory()
        counts = StatusCounts.of(Solver.SPARSE_NNLS, solved.status)
        return replace(entries, weight=solved.weights), counts

    def totals(self, weight: Tensor, taken: float) -> Totals:
        """Squared errors with weights `[N, C]`, of which the residual takes some away."""
        without, energy = self.error(weight), self.products.energy
        mean = max(energy - self.products.means, 0.0)
        return Totals(energy, without, max(without - taken, 0.0), mean)
