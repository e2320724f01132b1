"""Edit scripts: a YAML list of edits, each with its options and, if it likes, a mask.

- spread_normals: {factor: 1.6}
- hue_saturation: {hue: 120, mask: {stripes: {count: 4, share: 0.3}}}
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from ..config.schema import from_dict, load_yaml
from ..errors import ConfigError, SPMMError
from ..model.spmm import SPMM
from .edit_options import EDITS, Edit
from .mask_options import Mask, given, nearest, parse_mask, plain_mask


@dataclass(frozen=True)
class Step:
    """One edit, and where it acts; everywhere without a mask."""

    edit: Edit
    mask: Mask | None = None

    @property
    def name(self) -> str:
        """Of the edit, as scripts write it."""
        return next(name for name, kind in EDITS.items() if type(self.edit) is kind)

    def apply(self, model: SPMM) -> SPMM:
        """The edited model."""
        return self.edit.apply(model, None if self.mask is None else self.mask.select(model))


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
                f"an edit script holds {type(items).__name__}; expected a list of edits such as "
                f"'- intensity: {{factor: 2}}'."
            )
        if folder is not None:
            items = map_paths(items, lambda path: str(Path(folder) / path))
        return cls(tuple(_parse_step(item, number) for number, item in enumerate(items, 1)))

    @classmethod
    def read(cls, path: Path | str) -> Script:
        """The script in a YAML file; paths in it are relative to its folder.

        Raises:
            ConfigError: no such file, no YAML, or no valid script.
        """
        return cls.parse(load_yaml(path), Path(path).resolve().parent)

    def plain(self) -> list[dict[str, Any]]:
        """Plain values that `parse` takes back; options at their defaults are left out."""
        return [_plain_step(step) for step in self.steps]

    def to_yaml(self) -> str:
        """The script as YAML text."""
        return yaml.safe_dump(self.plain(), sort_keys=False, allow_unicode=True)

    def apply(self, model: SPMM, progress: Callable[[int], object] | None = None) -> SPMM:
        """The model after all edits; masks are found in the model that each edit meets.

        Args:
            progress: told after each edit, with 1.

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


def map_paths(values: Any, change: Callable[[str], str]) -> Any:
    """Plain values with every text under a key `path` changed."""
    if isinstance(values, list):
        return [map_paths(item, change) for item in values]
    if not isinstance(values, dict):
        return values
    return {
        key: change(item) if key == "path" and isinstance(item, str) else map_paths(item, change)
        for key, item in values.items()
    }


def _parse_step(item: Any, number: int) -> Step:
    if not isinstance(item, dict) or len(item) != 1:
        raise ConfigError(
            f"edit {number} is {item!r}; expected one edit with its options, such as "
            f"'- intensity: {{factor: 2}}'."
        )
    ((name, options),) = item.items()
    if name not in EDITS:
        raise ConfigError(f"edit {number}: unknown edit {name}; {nearest(str(name), tuple(EDITS))}")
    options = {} if options is None else options
    mask = None
    if isinstance(options, dict) and "mask" in options:
        mask = parse_mask(options["mask"], f"edit {number}: {name}.mask")
        options = {key: value for key, value in options.items() if key != "mask"}
    return Step(from_dict(EDITS[name], options, f"edit {number}: {name}."), mask)


def _plain_step(step: Step) -> dict[str, Any]:
    options = given(step.edit)
    if step.mask is not None:
        options["mask"] = plain_mask(step.mask)
    return {step.name: options}
