"""Frozen dataclasses as settings: typed, ranged, read from YAML, with errors that help."""

from __future__ import annotations

import difflib
import math
import types
import typing
from dataclasses import MISSING, field, fields, is_dataclass
from typing import Any, NamedTuple

import yaml

from ..errors import ConfigError
from .written import NULLS, Written, load_text

REQUIRED = MISSING  # default of a setting that must be given
MAX_SEED = (1 << 63) - 1  # largest seed that all generators of random numbers take


def setting(
    default: Any,
    meaning: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | tuple[int, ...] | None = None,
) -> Any:
    """A dataclass field with its meaning, inclusive range and choices."""
    return field(
        default=default,
        metadata={"meaning": meaning, "low": low, "high": high, "choices": choices},
    )


def parse_value(text: str, assignment: str, cls: type) -> Any:
    """The value of an assignment `KEY=text`, which the type of the setting reads.

    Text stays as it is, unless it stands in quotes; all else is YAML.

    Raises:
        ConfigError: not valid YAML.
    """
    if str in _kinds(cls, assignment.partition("=")[0].strip()):
        bare = text.strip()
        quoted = len(bare) > 1 and bare[0] == bare[-1] and bare[0] in "'\""
        if not quoted:
            return None if bare in NULLS else Written(bare)
    try:
        return load_text(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {assignment}: the value is not valid YAML; mend it.") from error


def _kinds(cls: Any, key: str) -> tuple[Any, ...]:
    """The types that the setting `key` may have; none if there is no such setting."""
    for name in key.split("."):
        cls = typing.get_type_hints(cls).get(name) if is_dataclass(cls) else None
    return typing.get_args(cls) if isinstance(cls, types.UnionType) else (cls,)


def assign(values: dict[str, Any], path: list[str], value: Any) -> None:
    """Sets the key at `path` in nested mappings; `from_dict` refuses it where it is unknown.

    Raises:
        ConfigError: the path goes through a value that is not a section.
    """
    for name in path[:-1]:
        inner = values.setdefault(name, {})
        if not isinstance(inner, dict):
            raise ConfigError(f"{'.'.join(path)}: {name} is a value, not a section; use {name}=...")
        values = inner
    values[path[-1]] = value


def _names(cls: type) -> list[str]:
    return [item.name for item in fields(cls)]


def from_dict(cls: type, values: Any, where: str = "") -> Any:
    """A settings dataclass from a nested mapping; `where` is the prefix of its keys in messages.

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
            given[key] = checked(value, hints[key], spec.metadata, f"{where}{key}")
    for item in fields(cls):
        if item.name not in given and item.default is item.default_factory is MISSING:
            meaning = item.metadata["meaning"]
            raise ConfigError(f"{where}{item.name} is missing; expected {meaning}; add it.")
    return cls(**given)


def _unknown(cls: type, key: str, where: str) -> str:
    near = difflib.get_close_matches(key, _names(cls), n=1, cutoff=0.5)
    hint = f"did you mean {where}{near[0]}?" if near else f"valid: {', '.join(_names(cls))}."
    return f"unknown setting {where}{key}; {hint}"


def check_settings(settings: Any) -> None:
    """Checks every value of a settings dataclass without sections; for its `__post_init__`.

    Raises:
        ConfigError: a value of the wrong type or out of its range.
    """
    hints = typing.get_type_hints(type(settings))
    for item in fields(settings):
        checked(getattr(settings, item.name), hints[item.name], item.metadata, item.name)


def checked(value: Any, kind: Any, metadata: typing.Mapping[str, Any], where: str) -> Any:
    """The value, converted to its declared type; `where` names the setting in messages.

    Raises:
        ConfigError: wrong type or value out of range.
    """
    kinds = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if value is None and type(None) in kinds:
        return None
    kind = next(item for item in kinds if item is not type(None))
    if typing.get_origin(kind) is tuple:
        inner = typing.get_args(kind)[0]
        if isinstance(value, Written) and inner is not str:  # 0,0,8,8 as well as [0, 0, 8, 8]
            value = [Written(word.strip()) for word in value.split(",")]
        items = value if isinstance(value, (list, tuple)) else [value]
        if not items:
            raise ConfigError(f"{where} is empty; expected at least one value.")
        given = tuple(checked(item, inner, metadata, where) for item in items)
        return _each_once(given, where) if metadata.get("choices") else given
    choices, low, high = metadata.get("choices"), metadata.get("low"), metadata.get("high")
    value = _typed(value, kind, where)
    if choices and value not in choices:
        near = difflib.get_close_matches(str(value), map(str, choices), n=1)
        hint = f"; did you mean {near[0]}?" if near else "."
        raise ConfigError(f"{where} is {value!r}; expected {allowed(metadata)}{hint}")
    below, above = low is not None and value < low, high is not None and value > high
    if below or above or (isinstance(value, float) and not math.isfinite(value)):
        raise ConfigError(f"{where} is {value}; expected {allowed(metadata) or 'a finite number'}.")
    return value


def _each_once(names: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    """Names of choices, each of which counts once."""
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"{where} names {twice} twice; expected each once; leave one of them out."
        )
    return names


def allowed(metadata: typing.Mapping[str, Any]) -> str:
    """The choices or the range of a setting in words; empty if every value of its type is valid."""
    choices, low, high = metadata.get("choices"), metadata.get("low"), metadata.get("high")
    if choices:
        return f"one of {', '.join(map(str, choices))}"
    if low is None:
        return "" if high is None else f"at most {high}"
    return f"at least {low}" if high is None else f"{low} to {high}"


def _typed(value: Any, kind: type, where: str) -> Any:
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "a name"}
    if isinstance(value, Written):
        try:
            return value.as_type(kind)
        except ValueError as error:
            raise ConfigError(f"{where} is {value!r}; expected {names[kind]}.") from error
    if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    raise ConfigError(f"{where} is {value!r}; expected {names[kind]}.")


def plain(value: Any) -> Any:
    """A nested value with lists in place of tuples."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


class Description(NamedTuple):
    """A setting as a help text shows it.

    Attributes:
        key: name with the sections around it, such as `search.restarts`.
        default: value if none is given; `REQUIRED` if one must be given.
        meaning: help text.
        allowed: choices or range in words; empty if every value of the type is valid.
    """

    key: str
    default: Any
    meaning: str
    allowed: str


def describe(cls: type, prefix: str = "") -> list[Description]:
    """All settings of a settings dataclass, including those of its sections."""
    rows: list[Description] = []
    hints = typing.get_type_hints(cls)
    for item in fields(cls):
        if is_dataclass(hints[item.name]):
            rows += describe(hints[item.name], f"{prefix}{item.name}.")
        else:
            key, data = f"{prefix}{item.name}", item.metadata
            rows.append(Description(key, item.default, data["meaning"], allowed(data)))
    return rows
