"""What edits and masks have in common: their interfaces, their options, and checks of them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, Protocol

from ..config.schema import plain
from ..errors import ConfigError
from ..model.spmm import SPMM
from .selection import Selection

# Largest factor in a script; the functions take any.
MAX_FACTOR = 100.0


class Edit(Protocol):
    """An edit with its options: a frozen dataclass whose fields are made by `setting`."""

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model; `model` stays as it is."""
        ...


class Mask(Protocol):
    """A mask with its options, for any model: a frozen dataclass whose fields are settings."""

    def select(self, model: SPMM) -> Selection:
        """What it selects in a model."""
        ...


def check_factor(name: str, factor: float) -> None:
    """Checks a factor on weights, widths or tilts.

    Raises:
        ConfigError: negative or not finite.
    """
    if not 0.0 <= factor < float("inf"):
        raise ConfigError(f"{name} is {factor}; expected a finite number not below 0.")


def given(options: Any) -> dict[str, Any]:
    """The options of a dataclass that differ from their defaults, as plain values."""
    values = {item.name: (getattr(options, item.name), item.default) for item in fields(options)}
    return {name: plain(value) for name, (value, default) in values.items() if value != default}


def name_of(options: object, kinds: Mapping[str, type]) -> str:
    """The name under which the class of `options` is registered."""
    return next(name for name, kind in kinds.items() if type(options) is kind)


def nearest(name: str, known: Iterable[str]) -> str:
    """The end of an error message: which known name was meant, or all of them."""
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"valid: {', '.join(known) or 'none'}."
