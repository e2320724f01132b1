"""Layers of edits: what the sliders and a line of text did under one mask after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ...edit import Mask, Step
from .sliders import NEUTRAL, steps_of, values_of


@dataclass(frozen=True)
class Layer:
    """Edits under one mask: those of sliders, then those that were typed.

    Attributes:
        mask: of the edits; None for the whole texture.
        values: of the sliders that are not neutral, by name.
        typed: further steps, which have masks of their own.
    """

    mask: Mask | None = None
    values: tuple[tuple[str, float], ...] = ()
    typed: tuple[Step, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """Its part of the script."""
        return steps_of(dict(self.values), self.mask) + self.typed

    def with_values(self, values: Mapping[str, float]) -> Layer:
        """The layer with some sliders moved."""
        values = dict(self.values) | dict(values)
        kept = ((key, values[key]) for key in NEUTRAL if key in values)
        return replace(self, values=tuple(row for row in kept if row[1] != NEUTRAL[row[0]]))


Layers = tuple[Layer, ...]


def layers_of(steps: Sequence[Step]) -> Layers:
    """The layers that stand for steps, the last one for sliders to move on."""
    layers: list[Layer] = []
    while steps:
        alike = _leading(steps, _have_one_mask)
        moved = _leading(alike, _are_of_sliders)
        typed = _leading(alike[len(moved) :], _ends_without_slider)
        values = values_of([step.edit for step in moved]) or {}
        layer = Layer(steps[0].mask).with_values(values)
        layers.append(replace(layer, typed=tuple(typed)))
        steps = steps[len(moved) + len(typed) :]
    if not layers or layers[-1].typed:
        layers.append(Layer(layers[-1].mask if layers else None))
    return tuple(layers)


def _leading(steps: Sequence[Step], holds: Callable[[Sequence[Step]], bool]) -> Sequence[Step]:
    """The longest part of steps, from the first on, that something holds for up to each of them."""
    count = 0
    while count < len(steps) and holds(steps[: count + 1]):
        count += 1
    return steps[:count]


def _have_one_mask(steps: Sequence[Step]) -> bool:
    return steps[-1].mask == steps[0].mask


def _are_of_sliders(steps: Sequence[Step]) -> bool:
    return values_of([step.edit for step in steps]) is not None


def _ends_without_slider(steps: Sequence[Step]) -> bool:
    return not _are_of_sliders(steps[-1:])
