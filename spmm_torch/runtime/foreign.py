"""What lies in the place of a file that is wanted: nothing, a device, an archive, a web page."""

from __future__ import annotations

import errno
import os
import stat
from dataclasses import dataclass
from pathlib import Path

HEAD_BYTES = 512
# The word that a tar has in its first header, and where.
TAR_WORD, TAR_PLACE = b"ustar", 257
UNPACKING = "unpack it"


@dataclass(frozen=True)
class Foreign:
    """A kind of file that is read by other programs.

    Attributes:
        what: the kind, in words that fit behind "it is".
        remedy: what to do about it.
    """

    what: str
    remedy: str


POINTER = Foreign(
    "a pointer of Git LFS in place of the file itself",
    "fetch the file by `git lfs install` and `git lfs pull`",
)
WEB_PAGE = Foreign(
    "a web page, as of a download that asks something first",
    "download the file again in a browser",
)
EMPTY = Foreign("an empty file, of 0 bytes", "copy or download it again")
TAR = Foreign("a tar archive", f"{UNPACKING} by `tar -xf` and give the folder")
# Kinds by their first bytes.
KINDS: tuple[tuple[bytes, Foreign], ...] = (
    (b"version https://git-lfs", POINTER),
    (b"<!doctype html", WEB_PAGE),
    (b"<html", WEB_PAGE),
    (b"7z\xbc\xaf\x27\x1c", Foreign("a 7z archive", f"{UNPACKING} by `7z x` and give the folder")),
    (b"Rar!\x1a\x07", Foreign("a RAR archive", f"{UNPACKING} by `unrar x` and give the folder")),
    *(
        (start, Foreign(f"compressed by {name}", f"{UNPACKING} by `tar -xf`, or by `{alone}`"))
        for start, name, alone in (
            (b"\x1f\x8b", "gzip", "gunzip"),
            (b"BZh", "bzip2", "bunzip2"),
            (b"\xfd7zXZ\0", "xz", "unxz"),
            (b"\x28\xb5\x2f\xfd", "zstd", "unzstd"),
        )
    ),
)


def foreign_kind(head: bytes) -> Foreign | None:
    """The kind of a file that starts with these bytes; None if it is none of these."""
    if not head:
        return EMPTY
    start = head.lstrip().lower()  # as of web pages; no other kind begins with a blank
    for magic, kind in KINDS:
        if head.startswith(magic) or start.startswith(magic):
            return kind
    return TAR if head[TAR_PLACE:].startswith(TAR_WORD) else None


def absence(path: Path | str) -> str | None:
    """Why there is neither a file nor a folder, in words that fit behind a path; None if there is.

    Pipes are none: they cannot be read twice, and an open one may wait for ever.
    """
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        if os.path.islink(path) and error.errno in (errno.ENOENT, errno.ELOOP):
            return f"is a link to {os.readlink(path)}, where nothing lies"
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            return "does not exist"
        return f"cannot be reached ({error.strerror})"
    except ValueError:  # a name that no file can have
        return "does not exist"
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        return None
    return "is neither a file nor a folder, but a pipe or a device"


def foreign_file(path: Path) -> Foreign | None:
    """The kind of a file; None if it is none of these, or is no file that can be read."""
    try:
        with path.open("rb") as file:
            return foreign_kind(file.read(HEAD_BYTES))
    except OSError:
        return None
