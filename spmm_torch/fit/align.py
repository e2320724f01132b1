"""Stage relief: the surface that the pictures show, through which their values are aligned."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import MIRROR, REPEAT
from ..model.relief import MAX_HEIGHT, Relief
from ..runtime.allocator import give_back_freed_memory
from .problem import Problem
from .relief.estimate import estimate_relief


@dataclass(frozen=True)
class FoundRelief:
    """The relief of a BTF as a checkpoint holds it.

    Attributes:
        height: heights `[T]`, of which a plane has one; empty where the surface is flat.
        drift: registration of each picture, `[V, 2]`; empty for none.
        mirrored: whether the texture continues mirrored beyond its border, `[]` bool.
    """

    height: Tensor
    drift: Tensor
    mirrored: Tensor

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `height [T]`, `drift [V, 2]` and `mirrored []`."""
        return dict(vars(self))

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> FoundRelief:
        """The relief of a checkpoint; see `FoundRelief.to_tensors`."""
        return cls(**tensors)

    def relief(self, texels: int) -> Relief | None:
        """The relief of T texels, rounded to what a file holds; None where the surface is flat."""
        if not len(self.height) and not len(self.drift):
            return None
        height = self.height if len(self.height) else torch.zeros(1)
        rule = MIRROR if bool(self.mirrored) else REPEAT
        drift = self.drift if len(self.drift) else None
        return Relief.of_heights(height.expand(texels), rule, drift)


def align(problem: Problem) -> Problem:
    """The problem with values aligned through the relief of the BTF, where that pays.

    Raises:
        ConfigError: its heights are greater than a model may have.
        DataError: the map of heights that the settings name is not valid.
    """
    context, config = problem.context, problem.config.relief
    if config.mode == "off" or problem.pictures.names is not None:  # no neighbours, no surface
        return problem

    def find() -> FoundRelief:
        found = estimate_relief(
            problem.pictures,
            mode=config.mode,
            height=config.height,
            height_scale=config.height_scale,
            drift=config.drift,
            device=problem.device,
        )
        for line in found.lines:
            context.progress.say(line)
        height = found.height
        if height is not None and not isinstance(height, Tensor):
            height = torch.tensor([height])
        _check_reach(height)
        return FoundRelief(
            torch.zeros(0) if height is None else height.flatten().cpu(),
            torch.zeros(0, 2) if found.drift is None else -found.drift.cpu(),
            torch.tensor(found.rule == MIRROR),
        )

    def work() -> FoundRelief:
        with context.watch("relief"):  # inside, so that a checkpoint keeps the seconds
            return context.ranks.first(find)

    with context.progress.stage("relief"):
        found = context.once("relief", FoundRelief, work)
    give_back_freed_memory()
    relief = found.relief(problem.pictures.texel_count)
    return problem if relief is None else problem.through(relief)


def _check_reach(height: Tensor | None) -> None:
    """Refuses heights that no model has; only those of a map that is given are so great."""
    reach = 0.0 if height is None else float(height.abs().max())
    if reach > MAX_HEIGHT:
        raise ConfigError(
            f"heights by relief.height and relief.height_scale reach {reach:.2f} texture widths; "
            f"expected at most {MAX_HEIGHT}; lower relief.height_scale."
        )
