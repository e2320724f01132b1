"""Paths in files, which hold UTF-8, and in this process, whose locale may be another.

Where the locale is UTF-8, as nearly everywhere, both are the same.
"""

from __future__ import annotations

import os
from pathlib import Path


def path_of(text: str) -> str:
    """A path that the text of a file names, as this process names it."""
    return os.fsdecode(text.encode("utf-8", "surrogateescape"))


def text_of(path: Path | str) -> str:
    """A path as the text of a file names it, and as libraries take it that want UTF-8.

    Bytes that are no UTF-8 stay surrogates.
    """
    return os.fsencode(path).decode("utf-8", "surrogateescape")
