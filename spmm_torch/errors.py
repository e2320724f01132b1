"""Errors that a user can mend: one family, so that the command line can tell them from bugs."""

from __future__ import annotations

from collections.abc import Sequence


class SPMMError(Exception):
    """Base of every error caused by input; its text is one sentence that says what to do.

    The command line prints the text and exits with code 2. Bugs raise anything else.
    """


class DataError(SPMMError):
    """A BTF, or a file that should hold one, is missing, malformed or empty."""


class ConfigError(SPMMError):
    """A setting is unknown, of the wrong type or out of its range."""


class OutputError(SPMMError):
    """A run folder cannot be written or read."""


def alternatives(words: Sequence[str]) -> str:
    """`A, B or C`, as sentences list what was expected."""
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
