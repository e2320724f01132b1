"""Folders and zips of pictures, and the files in them."""

from __future__ import annotations

import stat
import threading
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path, PurePosixPath

from ..errors import DataError
from ..runtime.atomic import readable
from .codecs.base import UnsuitableError
from .folder_files import folder_files, is_hidden
from .inner_zip import inner_member, unpacked

ZIP_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    RuntimeError,
    NotImplementedError,
    EOFError,
    UnicodeDecodeError,  # of names that are flagged as UTF-8 and are not
)
# Names of methods of compression that the library of Python cannot undo, by their number in a zip.
FOREIGN_METHODS = {9: "Deflate64", 93: "Zstandard", 95: "XZ", 96: "JPEG", 98: "PPMd", 99: "AES"}
# Methods that it can undo; the last one from Python 3.14 on.
METHODS = frozenset(
    getattr(zipfile, name, zipfile.ZIP_STORED)
    for name in ("ZIP_STORED", "ZIP_DEFLATED", "ZIP_BZIP2", "ZIP_LZMA", "ZIP_ZSTANDARD")
)
ENCRYPTED = 0x1  # flag of a member
UNIX = 3  # number of the system whose modes are in the upper half of the attributes
MAC_FOLDER = "__MACOSX"
# Zips whose names are kept: every reader asks for them.
KEPT_LISTS = 4
# Parts of names that a path would not have: few zips have any.
UNUSUAL = ("//", "./", "/.")


class Archive:
    """Reader of the members of a zip or the files of a folder; threads may share it."""

    def __init__(self, path: Path, handle: zipfile.ZipFile | None) -> None:
        self._path = path
        self._handle = handle
        self._members = {} if handle is None else dict(_members(handle))
        # A ZipFile does not lock the count of its readers.
        self._lock = threading.Lock()

    def check(self, names: Sequence[str]) -> None:
        """Refuses members of a zip that no complete copy would make readable.

        Raises:
            DataError: a member is encrypted, or compressed in a way that Python does not know.
        """
        if self._handle is not None:
            for name in names:
                _check_readable(self._path, name, self._members[name])

    def read(self, names: Sequence[str]) -> list[bytes]:
        """The contents of some files, read in one go.

        Raises:
            DataError: a file cannot be read.
        """
        if self._handle is None:
            return [self._read_file(name) for name in names]
        with self._lock:
            return [self._read_member(self._handle, name) for name in names]

    def checksum(self, name: str) -> int:
        """The checksum of a member that a zip holds of it.

        Raises:
            KeyError: there is no such member.
        """
        return self._members[name].CRC

    def _read_file(self, name: str) -> bytes:
        try:
            return (self._path / name).read_bytes()
        except OSError as error:
            raise unreadable(self._path, name, error) from error

    def _read_member(self, handle: zipfile.ZipFile, name: str) -> bytes:
        try:
            return handle.read(self._members[name])
        except (*ZIP_ERRORS, OSError, KeyError) as error:
            raise unreadable(self._path, name, error) from error


def unreadable(path: Path, name: str, error: Exception) -> DataError:
    """The error for a picture that cannot be read or decoded."""
    if isinstance(error, UnsuitableError):
        return DataError(f"picture {name!r} in {path} cannot be used: {error}.")
    return DataError(
        f"picture {name!r} in {path} cannot be read ({error}); expected a complete picture; "
        f"restore this file from the original data set."
    )


def _check_readable(path: Path, name: str, member: zipfile.ZipInfo) -> None:
    if member.flag_bits & ENCRYPTED:
        fault = "is encrypted"
    elif member.create_system == UNIX and stat.S_ISLNK(member.external_attr >> 16):
        fault = "is a link"
    elif member.compress_type not in METHODS:
        method = FOREIGN_METHODS.get(member.compress_type, f"method {member.compress_type}")
        fault = f"is compressed by {method}, which Python cannot undo"
    else:
        return
    raise DataError(
        f"{name!r} in {path} {fault}; expected plain files, stored or compressed by Deflate; "
        f"unpack the zip with the program that made it, such as 7-Zip, and give the folder."
    )


def is_container(path: Path) -> bool:
    """Whether a path is a folder or a zip."""
    return path.is_dir() or zipfile.is_zipfile(path)


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Opens a folder or a zip for reading.

    Raises:
        DataError: the zip is damaged.
    """
    if path.is_dir():
        yield Archive(path, None)
        return
    with open_zip(path) as handle:
        yield Archive(path, handle)


def open_zip(path: Path) -> zipfile.ZipFile:
    """Opens a zip for reading, or the zip in it that is most of it.

    Raises:
        DataError: the zip is damaged or cannot be read.
        OutputError: there is no space to unpack the inner zip.
    """
    try:
        return innermost_zip(path)
    except (*ZIP_ERRORS, OSError) as error:
        raise _unopened(path, error) from error


def _unopened(path: Path, error: Exception) -> DataError:
    """The error for a zip that cannot be opened."""
    return DataError(
        f"{path} cannot be opened ({error}); expected a complete zip or a folder; "
        f"check that it is still there, or copy it again."
    )


def innermost_zip(path: Path) -> zipfile.ZipFile:
    """Opens a zip as `open_zip` does, with the errors of the library.

    Raises:
        DataError: the inner zip has a form that cannot be read.
        OutputError: there is no space to unpack it.
        OSError, zipfile.BadZipFile: the zip is damaged or cannot be read.
    """
    outer = zipfile.ZipFile(path)
    inner = inner_member(list(_members(outer)))
    if inner is None:
        return outer
    with outer:
        _check_readable(path, *inner)
        return zipfile.ZipFile(unpacked(path, inner[1]))


def list_files(path: Path) -> list[str]:
    """Sorted relative names of the files of a zip or folder, without those of macOS.

    Files whose own name starts with a dot are left out.

    Raises:
        DataError: the zip is damaged, or a link in the folder leads nowhere.
    """
    if path.is_dir():
        names = folder_files(path)
    else:
        try:
            status = path.stat()
        except OSError as error:
            raise _unopened(path, error) from error
        names = _names_in_zip(path, status.st_mtime_ns, status.st_size)
    return sorted(name for name in names if not _is_of_the_system(name))


@lru_cache(KEPT_LISTS)
def _names_in_zip(path: Path, _time: int, _size: int) -> tuple[str, ...]:
    """The names in a zip, until it changes."""
    with open_zip(path) as handle:
        return tuple(name for name, _ in _members(handle))


def beside_inner_zip(path: Path) -> list[str]:
    """Sorted names of the files beside the zip that is most of a zip; none for anything else.

    Raises:
        DataError: the zip is damaged.
    """
    if not zipfile.is_zipfile(path):
        return []
    try:
        with zipfile.ZipFile(path) as outer:
            members = list(_members(outer))
    except (*ZIP_ERRORS, OSError) as error:
        raise _unopened(path, error) from error
    inner = inner_member(members)
    names = [] if inner is None else [name for name, _ in members if name != inner[0]]
    return sorted(name for name in names if not _is_of_the_system(name))


def shown(names: Sequence[str]) -> list[str]:
    """The names without hidden folders; all of them if each lies in one."""
    return [name for name in names if not is_hidden(name)] or list(names)


def material_name(path: Path) -> str:
    """A short name of the material at a path: that of the folder, or of the file without suffix."""
    resolved = path.resolve()
    return readable(resolved.name if resolved.is_dir() else resolved.stem)


def _members(handle: zipfile.ZipFile) -> Iterator[tuple[str, zipfile.ZipInfo]]:
    """Files in a zip, with names as they would be in a folder."""
    listed = set()
    for member in handle.infolist():
        # Some programs list a file twice, which Python takes for an attack where it is read.
        if (entry := (member.filename, member.header_offset)) in listed:
            continue
        listed.add(entry)
        # Windows writes back-slashes, and some programs "./" in front.
        name = member.filename.replace("\\", "/")
        if name.endswith("/"):
            continue
        unusual = any(part in name for part in UNUSUAL)
        yield str(PurePosixPath(name)) if unusual else name, member


def _is_of_the_system(name: str) -> bool:
    parts = name.split("/")
    return MAC_FOLDER in parts or parts[-1].startswith(".")
