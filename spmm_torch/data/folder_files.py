"""Files of a folder, through links, without leaving anything out in silence."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from ..errors import DataError

Identity = tuple[int, int]  # device and number of a folder, the same by all of its names


def folder_files(folder: Path) -> list[str]:
    """Relative names of all files in a folder and the folders in it, "/" between them.

    Links are followed. Faults among names that start with a dot do not count.

    Raises:
        DataError: a link leads nowhere or back to a folder around it, or something is no file.
        OSError: a folder cannot be read.
    """
    names, lost = [], []
    for name, is_file in _walk(folder, folder, "", ()):
        if is_file:
            names.append(name)
        elif not is_hidden(name):
            lost.append(name)
    if lost:
        raise _lost(folder, sorted(lost))
    return names


def is_hidden(name: str) -> bool:
    """Whether a file, or a folder that it is in, has a name that starts with a dot."""
    return any(part.startswith(".") for part in name.split("/"))


def _walk(
    folder: Path, place: Path, prefix: str, above: tuple[Identity, ...]
) -> Iterator[tuple[str, bool]]:
    """The name of everything that is no folder, and whether it is a file."""
    identity = _identity(place)
    if identity in above:
        if not is_hidden(prefix[:-1]):
            raise DataError(
                f"link {prefix[:-1]!r} in {folder} leads back to a folder that it lies in; "
                f"expected links that end; remove it."
            )
        return
    with os.scandir(place) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        name = prefix + entry.name
        linked = entry.is_symlink()  # else its kind is known without another look at the disk
        if os.path.isdir(entry.path) if linked else entry.is_dir():
            yield from _walk(folder, Path(entry.path), f"{name}/", (*above, identity))
        else:
            yield name, os.path.isfile(entry.path) if linked else entry.is_file()


def _identity(folder: Path) -> Identity:
    status = folder.stat()
    return status.st_dev, status.st_ino


def _lost(folder: Path, names: list[str]) -> DataError:
    """The error for names that stand for no file."""
    path = folder / names[0]
    more = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
    if path.is_symlink():
        return DataError(
            f"link {names[0]!r} in {folder}{more} leads to {os.readlink(path)!r}, which cannot be "
            f"opened; expected a file or folder; fetch or restore it, or remove the link."
        )
    return DataError(
        f"{names[0]!r} in {folder}{more} is neither a file nor a folder; expected pictures; remove "
        f"it."
    )
