"""Edits and masks as plain values, such as YAML gives them, and back.

An edit is a mapping of one key, its name, to its options and a `mask`. A mask is a mapping of one
key, its kind, to its options: `{rectangle: {x: 0, y: 0, width: 8, height: 4}}`. Masks combine as
`{all: [...]}`, `{any: [...]}` and `{not: ...}`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..config.schema import from_dict
from ..errors import ConfigError
from .edits import EDITS
from .masks import MASKS
from .masks.combined import COMBINATIONS, Combined
from .options import Edit, Mask, given, name_of, nearest


def parse_edit(item: Any, number: int) -> tuple[Edit, Mask | None]:
    """The edit of plain values, and its mask if it has one.

    Args:
        item: a mapping of one key.
        number: its place in the script, for messages.

    Raises:
        ConfigError: unknown edit, option or mask, wrong type, or out of range.
    """
    if not isinstance(item, dict) or len(item) != 1:
        raise ConfigError(
            f"edit {number} is {item!r}; expected one edit with its options, such as "
            f"'- intensity: {{factor: 2}}'."
        )
    ((name, options),) = item.items()
    if name not in EDITS:
        raise ConfigError(f"edit {number}: unknown edit {name}; {nearest(str(name), EDITS)}")
    options = {} if options is None else options
    mask = None
    if isinstance(options, dict) and "mask" in options:
        mask = parse_mask(options["mask"], f"edit {number}: {name}.mask")
        options = {key: value for key, value in options.items() if key != "mask"}
    return from_dict(EDITS[name], options, f"edit {number}: {name}."), mask


def plain_edit(edit: Edit, mask: Mask | None) -> dict[str, Any]:
    """Plain values that `parse_edit` takes back; options at their defaults are left out."""
    options = given(edit)
    if mask is not None:
        options["mask"] = plain_mask(mask)
    return {name_of(edit, EDITS): options}


def parse_mask(value: Any, where: str) -> Mask:
    """The mask of plain values.

    Args:
        value: a mapping of one key.
        where: its place in the script, for messages.

    Raises:
        ConfigError: unknown kind or option, wrong type, or out of range.
    """
    known = (*MASKS, *COMBINATIONS)
    if not isinstance(value, dict) or len(value) != 1:
        raise ConfigError(
            f"{where} is {value!r}; expected one kind of mask with its options, such as "
            f"{{cluster: {{number: 3}}}}; kinds: {', '.join(known)}."
        )
    ((kind, options),) = value.items()
    if kind in MASKS:
        return from_dict(MASKS[kind], options, f"{where}.{kind}.")
    if kind == "not":
        return Combined("not", (parse_mask(options, f"{where}.not"),))
    if kind in COMBINATIONS:
        if not isinstance(options, list) or not options:
            raise ConfigError(f"{where}.{kind} is {options!r}; expected a list of masks.")
        parts = [parse_mask(part, f"{where}.{kind}[{i}]") for i, part in enumerate(options)]
        return Combined(kind, tuple(parts))
    raise ConfigError(f"{where} names the unknown mask {kind}; {nearest(str(kind), known)}")


def plain_mask(mask: Mask) -> dict[str, Any]:
    """Plain values that `parse_mask` takes back; options at their defaults are left out."""
    if isinstance(mask, Combined):
        parts = [plain_mask(part) for part in mask.masks]
        return {mask.kind: parts[0] if mask.kind == "not" else parts}
    return {name_of(mask, MASKS): given(mask)}


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
