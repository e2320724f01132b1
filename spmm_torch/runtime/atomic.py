"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError
from .names import text_of

# Fixed time of zip members, so that zips of the same content are the same bytes.
TIMESTAMP = (1980, 1, 1, 0, 0, 0)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it at the end; an old file there is replaced.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = _temporary(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


@contextmanager
def new_file(path: Path | str) -> Iterator[Path]:
    """As `replacing`, with an OutputError in place of the system's error.

    Raises:
        OutputError: the file cannot be written.
    """
    target = Path(path)
    with output_errors(target), replacing(target) as temporary:
        yield temporary


def write_atomic(path: Path, content: bytes) -> None:
    """Writes the whole file or nothing.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def new_folder(path: Path | str) -> Iterator[Path]:
    """An empty folder under a temporary name beside `path`, renamed to it at the end.

    Raises:
        OutputError: `path` exists, or the folder cannot be written.
    """
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target} exists; expected a new name; choose one or remove it.")
    temporary = _temporary(target)
    try:
        with output_errors(target):
            temporary.mkdir()
            yield temporary
            os.replace(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def output_errors(target: Path) -> Iterator[None]:
    """Turns errors of the system into an OutputError that names `target`.

    Raises:
        OutputError: the system refuses what the block under `with` does.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{target} cannot be written ({error}); expected a writable folder with enough space; "
            f"choose another place."
        ) from error


def is_text(text: str) -> bool:
    """Whether UTF-8 can hold a text; the name of a file may hold bytes that it cannot."""
    return not any("\ud800" <= letter <= "\udfff" for letter in text)


def readable(text: str) -> str:
    """The text with escapes in place of bytes that are no UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode()


def zip_member(name: str) -> zipfile.ZipInfo:
    """The entry of an uncompressed zip member, with a fixed time."""
    return zipfile.ZipInfo(readable(text_of(name)), TIMESTAMP)


def _temporary(target: Path) -> Path:
    """A hidden name of this process beside the target."""
    return target.with_name(f".{target.name}.{os.getpid()}.tmp")
