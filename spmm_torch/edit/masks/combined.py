"""Several masks in one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

from ...model.spmm import SPMM
from ..options import Mask
from ..selection import Selection

# What each kind makes of the selections of its masks.
COMBINATIONS: dict[str, Callable[[list[Selection]], Selection]] = {
    "all": lambda parts: reduce(lambda a, b: a & b, parts),
    "any": lambda parts: reduce(lambda a, b: a | b, parts),
    "not": lambda parts: ~parts[0],
}


@dataclass(frozen=True)
class Combined:
    """Several masks in one.

    Attributes:
        kind: one of COMBINATIONS.
        masks: exactly one for `not`, at least one for the others.
    """

    kind: str
    masks: tuple[Mask, ...]

    def select(self, model: SPMM) -> Selection:
        """What they select together in a model."""
        return COMBINATIONS[self.kind]([mask.select(model) for mask in self.masks])
