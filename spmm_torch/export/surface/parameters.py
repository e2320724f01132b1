"""Parameters of a surface, and the interface of its parametrizations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

# Parameters of T texels by name, `[T, n]` each.
Values = Mapping[str, Tensor]


@dataclass(frozen=True)
class Parameter:
    """One parameter, in its own unit.

    Attributes:
        name: of the parameter.
        size: numbers, n: 3 for a colour.
        start: where a fit begins.
        low, high: its range.
        power: a fit moves in the root of this order, in which dark colours are as far apart as
            they look.
    """

    name: str
    size: int
    start: float
    low: float = 0.0
    high: float = 1.0
    power: float = 1.0

    def value(self, unit: Tensor) -> Tensor:
        """The parameter of numbers in 0..1."""
        return self.low + (self.high - self.low) * unit**self.power

    def unit(self, value: Tensor) -> Tensor:
        """The numbers in 0..1 of a parameter."""
        share = (value - self.low) / (self.high - self.low)
        return share.clamp(0.0, 1.0) ** (1.0 / self.power)


# A normal's x and y: all surfaces have it. Beyond 45 degrees at most views are under its horizon.
NORMAL = Parameter("normal", 2, 0.0, -0.7, 0.7)


class Surface(Protocol):
    """A parametrization: which parameters a surface has, and its values."""

    @property
    def core(self) -> tuple[Parameter, ...]:
        """What every texel has."""
        ...

    @property
    def layers(self) -> Mapping[str, tuple[Parameter, ...]]:
        """What is added where it pays, by name."""
        ...

    def eval(self, values: Values, wi: Tensor, wo: Tensor) -> Tensor:
        """Cosine-weighted RGB `[T, S, 3]`.

        Args:
            values: parameters of the core and of any layers, `[T, n]` each.
            wi, wo: unit directions that all texels share, `[3, S]`, or one for each, `[T, 3, 1]`.
        """
        ...


def joined(values: Values, parameters: tuple[Parameter, ...]) -> Tensor:
    """Numbers in 0..1 `[T, P]` of parameters."""
    return torch.cat([each.unit(values[each.name]) for each in parameters], dim=1)


def split(units: Tensor, parameters: tuple[Parameter, ...]) -> dict[str, Tensor]:
    """Parameters by name `[T, n]` of numbers in 0..1 `[T, P]`."""
    columns = units.split([each.size for each in parameters], dim=1)
    return {each.name: each.value(part) for each, part in zip(parameters, columns, strict=True)}


def start_of(parameters: tuple[Parameter, ...], texels: int, like: Tensor) -> dict[str, Tensor]:
    """The starts of parameters, `[T, n]` each, of the type and device of `like`."""
    return {each.name: like.new_full((texels, each.size), each.start) for each in parameters}
