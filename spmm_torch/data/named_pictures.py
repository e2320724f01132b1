"""Pictures of a zip or folder that are named by their directions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..errors import DataError, alternatives
from .codecs import CODECS, SUFFIXES
from .file_names import parse_angles
from .options import ReadOptions
from .picture_grid import PictureGrid, arrange
from .pictures import list_files, shown

KINDS = alternatives([codec.TITLE for codec in reversed(CODECS)])
EXPECTED = (
    f"a zip or folder of {KINDS} pictures named by their angles "
    "(like '00008 tl000 pl000 tv030 pv030.jpg')"
)


def list_pictures(path: Path, pattern: str | None = None) -> list[str]:
    """Names of the pictures in a zip or folder that are named by their directions."""
    return _named(list_files(path), pattern)


def _named(files: Sequence[str], pattern: str | None) -> list[str]:
    """Names of the pictures among files that are named by their directions."""
    named = (name for name in files if parse_angles(name, pattern) is not None)
    return shown([name for name in named if is_picture(name)])


def is_picture(name: str) -> bool:
    """Whether a file is a picture by its name."""
    return name.lower().endswith(SUFFIXES)


def find_grid(path: Path, files: Sequence[str], options: ReadOptions) -> PictureGrid:
    """The pictures of a zip or folder, arranged by the directions in their names.

    Raises:
        DataError: a direction pair is missing or there twice, or no picture has directions.
    """
    names = _named(files, options.pattern)
    if not names:
        raise _nothing_named(path, files, options.pattern)
    parse = partial(parse_angles, pattern=options.pattern)
    return arrange(names, path, parse, options.missing == "mask")


def _nothing_named(path: Path, files: Sequence[str], pattern: str | None) -> DataError:
    """The error for a zip or folder without a picture whose name has directions."""
    pictures = shown([name for name in files if is_picture(name)])
    there = f"the first one is {pictures[0]!r}" if pictures else "it holds no pictures"
    wanted = EXPECTED if pattern is None else f"names like the pattern {pattern!r}"
    return DataError(
        f"{path} has no picture with directions in its name: {there}; expected {wanted}; mend the "
        f"names, or give the pattern that they follow with --pattern (data.pattern)."
    )
