"""Sizes of memory, as words of a command line; without torch, so that errors are quick."""

from __future__ import annotations

import re

from ..errors import ConfigError

UNITS = "KMGT"
SIZE = re.compile(rf"\s*(\d+(?:\.\d+)?)\s*(?:([{UNITS}])(I?))?B?\s*", re.IGNORECASE)


def parse_size(text: str) -> int:
    """The bytes that a text such as `4GB`, `500 MB` or `3GiB` names.

    Raises:
        ConfigError: the text names no size.
    """
    match = SIZE.fullmatch(text)
    if match is None:
        raise ConfigError(f"{text!r} is no size; expected a number with a unit such as 4GB.")
    number, unit, binary = match.groups()
    power = UNITS.index(unit.upper()) + 1 if unit else 0
    return int(float(number) * (1024 if binary else 1000) ** power)
