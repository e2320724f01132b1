"""Errors that a user can mend, in one family: the command line tells them from bugs by it."""

from __future__ import annotations

from collections.abc import Sequence


class SPMMError(Exception):
    """Base of all errors caused by input; its text is one sentence that says what to do.

    The command line prints the text and exits with code 2. Bugs raise anything else.
    """


class DataError(SPMMError):
    """A BTF, or a file that should hold one, is missing, malformed or empty."""


class ConfigError(SPMMError):
    """A setting is unknown, of the wrong type or out of its range."""


class OutputError(SPMMError):
    """A run folder cannot be written or read."""


def alternatives(words: Sequence[str]) -> str:
    """The words as a list in a sentence: `A, B or C`."""
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
