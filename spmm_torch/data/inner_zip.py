"""The zip inside a zip, unpacked for as long as the program runs."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import zipfile
from functools import cache
from pathlib import Path

from ..errors import OutputError

# Bytes that are copied at once.
BLOCK = 1 << 20


def inner_member(members: list[tuple[str, zipfile.ZipInfo]]) -> tuple[str, zipfile.ZipInfo] | None:
    """The zip among the (name, member) of a zip that is larger than all others together, if any."""
    zips = [found for found in members if found[0].lower().endswith(".zip")]
    total = sum(member.file_size for _, member in members)
    return next((found for found in zips if 2 * found[1].file_size > total), None)


def unpacked(path: Path, member: zipfile.ZipInfo) -> Path:
    """A copy of a zip that a zip holds; the same one until the outer zip changes.

    Raises:
        OutputError: there is no space for it.
        OSError: the outer zip cannot be read.
    """
    status = path.stat()
    return _copy(path, status.st_mtime_ns, status.st_size, member.filename)


@cache
def _copy(path: Path, _time: int, _size: int, name: str) -> Path:
    """The copy, which goes when the program ends."""
    with zipfile.ZipFile(path) as outer, outer.open(name) as source:
        try:
            with tempfile.NamedTemporaryFile(
                prefix="spmm_torch.", suffix=".zip", delete=False
            ) as target:
                atexit.register(Path(target.name).unlink, missing_ok=True)
                shutil.copyfileobj(source, target, BLOCK)
        except OSError as error:
            raise OutputError(
                f"the zip {name!r} in {path} cannot be unpacked ({error}); expected as much space "
                f"in {tempfile.gettempdir()}; unpack it elsewhere, and give that zip."
            ) from error
    return Path(target.name)
