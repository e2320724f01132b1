"""The way of every export: written whole or not at all, measured, and what is left out named."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import OutputError
from ..model.spmm import SPMM
from ..runtime.atomic import new_file, new_folder
from ..runtime.progress import Progress
from .loss import Loss, has_residual, loss_of
from .target import LOBES, PARTS, RELIEF, RESIDUAL, Target

COLOURS = 3


@dataclass(frozen=True)
class Outcome:
    """What an export lost.

    Attributes:
        left_out: what the target does not hold, one clause each.
        loss: how far what was written is from the model.
    """

    left_out: tuple[str, ...]
    loss: Loss

    def lines(self) -> list[str]:
        """For people: what is left out, and the figures."""
        return [*(f"left out: {clause}" for clause in self.left_out), self.loss.line()]


def export(
    model: SPMM, target: Target, output: Path | str, settings: Any, progress: Progress
) -> Outcome:
    """Writes a model for a target; what it makes is there whole or not at all.

    Args:
        model: on the device of the computation.
        target: of `TARGETS`.
        output: file or folder to make.
        settings: of the target's own class.
        progress: of the command.

    Raises:
        OutputError: the output exists or cannot be written, or the model has no colours.
    """
    if model.weight.shape[1] != COLOURS:
        raise OutputError(
            f"the model has {model.weight.shape[1]} channels; expected red, green and blue; "
            f"export a model of a colour BTF."
        )
    with _place(target, output) as place:
        exported = target.write(place, model, settings, progress)
        loss = loss_of(model, target.holds, exported.material)
    return Outcome((*left_out(model, target), *exported.notes), loss)


def left_out(model: SPMM, target: Target) -> tuple[str, ...]:
    """A clause for each part of a model that a target does not hold."""
    has = {LOBES: True, RESIDUAL: has_residual(model), RELIEF: model.relief is not None}
    lost = (part for part in PARTS if has[part] and part not in target.holds)
    return tuple(PARTS[part] for part in lost)


def _place(target: Target, output: Path | str) -> AbstractContextManager[Path]:
    """A new file or folder under a temporary name, renamed at the end."""
    if not target.suffix:
        return new_folder(output)
    if Path(output).exists() or Path(output).is_symlink():
        raise OutputError(f"{output} exists; expected a new name; choose one or remove it.")
    return new_file(output)
