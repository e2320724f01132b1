"""The residual of rank R as a file holds it."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ...model.components import decode_coefficients, decode_functions


@dataclass(frozen=True)
class RankResidual:
    """The residual of rank R as a file holds it, and what it takes off the squared error.

    Attributes:
        code: of the functions, `[R, V, L, C]`.
        scale: of the functions, `[R, V]`.
        coefficient: codes `[T, R]`.
        coefficient_scale: `[R]`.
        taken: squared error, by weight.
    """

    code: Tensor
    scale: Tensor
    coefficient: Tensor
    coefficient_scale: Tensor
    taken: float

    @property
    def functions(self) -> Tensor:
        """B `[V, R, L, C]`."""
        return decode_functions(self.code, self.scale).transpose(0, 1)

    @property
    def coefficients(self) -> Tensor:
        """c `[T, R]`."""
        return decode_coefficients(self.coefficient, self.coefficient_scale)
