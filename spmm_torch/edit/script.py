"""Edit scripts: a YAML list of edits, each with its options and, where it has one, a mask.

- spread_normals: {factor: 1.6}
- hue_saturation: {hue: 120, mask: {stripes: {count: 4, share: 0.3}}}
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..config.written import dump_text, kind_of, load_yaml
from ..errors import ConfigError, SPMMError
from ..model.spmm import SPMM
from .edits import EDITS
from .options import Edit, Mask, name_of
from .parsing import map_paths, parse_edit, plain_edit
from .selection import EVERYTHING


@dataclass(frozen=True)
class Step:
    """One edit, and the mask that it acts under; everywhere without one."""

    edit: Edit
    mask: Mask | None = None

    @property
    def name(self) -> str:
        """The name of the edit in scripts."""
        return name_of(self.edit, EDITS)

    def apply(self, model: SPMM) -> SPMM:
        """The edited model.

        Raises:
            SPMMError: the edit cannot be done, or makes weights that are not valid.
        """
        where = EVERYTHING if self.mask is None else self.mask.select(model)
        edited = self.edit.apply(model, where)
        check_weights(edited.weight.detach())
        return edited


def check_weights(weight: Tensor) -> None:
    """Checks the weights `[N, C]` that an edit has made.

    Raises:
        ConfigError: one is negative or not finite.
    """
    if not weight.numel():
        return
    low, high = (bound.item() for bound in torch.aminmax(weight))
    if not (low >= 0.0 and math.isfinite(high)):
        raise ConfigError(
            f"it makes weights of {low:g} to {high:g}; expected finite weights not below 0; "
            f"change its options, or correct the edit."
        )


@dataclass(frozen=True)
class Script:
    """Edits in their order."""

    steps: tuple[Step, ...] = ()

    @classmethod
    def parse(cls, items: Any, folder: Path | str | None = None) -> Script:
        """The script of plain values as YAML gives them.

        Args:
            items: a list of edits; None for an empty one.
            folder: what paths in it are relative to; None leaves them as they are.

        Raises:
            ConfigError: unknown edit, option or mask, wrong type, or out of range.
        """
        if items is None:
            return cls()
        if not isinstance(items, list):
            raise ConfigError(
                f"an edit script holds {kind_of(items)}; expected a list of edits such as "
                f"'- intensity: {{factor: 2}}'."
            )
        if folder is not None:
            items = map_paths(items, lambda path: str(Path(folder) / path))
        return cls(tuple(Step(*parse_edit(item, number)) for number, item in enumerate(items, 1)))

    @classmethod
    def read(cls, path: Path | str) -> Script:
        """The script in a YAML file; paths in it are relative to its folder.

        Raises:
            ConfigError: no such file, no YAML, or no valid script.
        """
        return cls.parse(load_yaml(path, "edit script"), Path(path).resolve().parent)

    def plain(self) -> list[dict[str, Any]]:
        """Plain values that `parse` takes back; options at their defaults are left out."""
        return [plain_edit(step.edit, step.mask) for step in self.steps]

    def to_yaml(self) -> str:
        """The script as YAML text."""
        return dump_text(self.plain(), unicode=True)

    def apply(self, model: SPMM, progress: Callable[[int], object] | None = None) -> SPMM:
        """The model after all edits; each mask is applied to the model that its edit meets.

        Args:
            model: the original, which stays as it is.
            progress: called after each edit, with 1.

        Raises:
            SPMMError: an edit cannot be done; the text begins with its number and name.
        """
        for number, step in enumerate(self.steps, 1):
            try:
                model = step.apply(model)
            except SPMMError as error:
                raise type(error)(f"edit {number} ({step.name}): {error}") from error
            if progress is not None:
                progress(1)
        return model

    def __add__(self, other: Script) -> Script:
        """These edits, then those of another script."""
        return Script(self.steps + other.steps)
