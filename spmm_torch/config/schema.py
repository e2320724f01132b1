"""Frozen dataclasses as settings: typed, ranged, read from YAML, with errors that help."""

from __future__ import annotations

import difflib
import math
import types
import typing
from contextlib import suppress
from dataclasses import MISSING, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from ..errors import ConfigError

REQUIRED = MISSING  # as the default of a setting: it has none


def setting(
    default: Any,
    meaning: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """A dataclass field with its meaning, inclusive range and choices."""
    return field(
        default=default,
        metadata={"meaning": meaning, "low": low, "high": high, "choices": choices},
    )


def load_yaml(path: Path | str) -> Any:
    """Whatever a YAML file holds.

    Raises:
        ConfigError: no such file, or no YAML.
    """
    try:
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"settings file {path} cannot be read ({error}); check it.") from error
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"settings file {path} is not valid YAML: {reason}; mend it.") from error


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigError: no such file, no YAML, or no mapping.
    """
    values = load_yaml(path)
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(
            f"settings file {path} holds {type(values).__name__}; expected sections "
            f"as in configs/default.yaml."
        )
    return values


def parse_value(text: str, assignment: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {assignment}: the value is not valid YAML; mend it.") from error


def assign(values: dict[str, Any], path: list[str], value: Any) -> None:
    """Writes a nested key; the unknown ones are left for `from_dict` to name."""
    for name in path[:-1]:
        inner = values.setdefault(name, {})
        if not isinstance(inner, dict):
            raise ConfigError(f"{'.'.join(path)}: {name} is a value, not a section; use {name}=...")
        values = inner
    values[path[-1]] = value


def _names(cls: type) -> list[str]:
    return [item.name for item in fields(cls)]


def from_dict(cls: type, values: Any, where: str = "") -> Any:
    """A settings dataclass from a nested mapping; `where` is its place, ending in a dot.

    Raises:
        ConfigError: unknown key, wrong type or value out of range.
    """
    if not isinstance(values, dict):
        raise ConfigError(
            f"{where[:-1]} is {values!r}; expected a section with keys like "
            f"{', '.join(_names(cls))}."
        )
    hints = typing.get_type_hints(cls)
    given = {}
    for key, value in values.items():
        if key not in hints:
            raise ConfigError(_unknown(cls, str(key), where))
        spec = next(item for item in fields(cls) if item.name == key)
        if is_dataclass(hints[key]):
            given[key] = from_dict(hints[key], value, f"{where}{key}.")
        else:
            given[key] = _checked(value, hints[key], spec.metadata, f"{where}{key}")
    for item in fields(cls):
        if item.name not in given and item.default is item.default_factory is MISSING:
            meaning = item.metadata["meaning"]
            raise ConfigError(f"{where}{item.name} is missing; expected {meaning}; add it.")
    return cls(**given)


def _unknown(cls: type, key: str, where: str) -> str:
    near = difflib.get_close_matches(key, _names(cls), n=1, cutoff=0.5)
    hint = f"did you mean {where}{near[0]}?" if near else f"valid: {', '.join(_names(cls))}."
    return f"unknown setting {where}{key}; {hint}"


def _checked(value: Any, kind: Any, metadata: typing.Mapping[str, Any], where: str) -> Any:
    """The value in its declared type and range."""
    kinds = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if value is None and type(None) in kinds:
        return None
    kind = next(item for item in kinds if item is not type(None))
    if typing.get_origin(kind) is tuple:
        items = value if isinstance(value, (list, tuple)) else [value]
        if not items:
            raise ConfigError(f"{where} is empty; expected at least one value.")
        inner = typing.get_args(kind)[0]
        return tuple(_checked(item, inner, metadata, where) for item in items)
    value = _typed(value, kind, where)
    choices, low, high = metadata.get("choices"), metadata.get("low"), metadata.get("high")
    if choices and value not in choices:
        near = difflib.get_close_matches(str(value), choices, n=1)
        hint = f"; did you mean {near[0]}?" if near else "."
        raise ConfigError(f"{where} is {value!r}; expected one of {', '.join(choices)}{hint}")
    below, above = low is not None and value < low, high is not None and value > high
    if below or above or (isinstance(value, float) and not math.isfinite(value)):
        span = f"at least {low}" if high is None else f"{low} to {high}"
        raise ConfigError(f"{where} is {value}; expected {span}.")
    return value


def _typed(value: Any, kind: type, where: str) -> Any:
    if kind is float and isinstance(value, str):  # YAML 1.1 reads 1e-3 as text
        with suppress(ValueError):
            return float(value)
    if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "a name"}
    raise ConfigError(f"{where} is {value!r}; expected {names[kind]}.")


def plain(value: Any) -> Any:
    """Tuples as lists, all through."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def describe(cls: type, prefix: str = "") -> list[tuple[str, Any, str]]:
    """(key, default, meaning) of every setting, for the help text."""
    rows: list[tuple[str, Any, str]] = []
    hints = typing.get_type_hints(cls)
    for item in fields(cls):
        if is_dataclass(hints[item.name]):
            rows += describe(hints[item.name], f"{prefix}{item.name}.")
        else:
            default = None if item.default is MISSING else item.default
            rows.append((prefix + item.name, default, item.metadata["meaning"]))
    return rows
