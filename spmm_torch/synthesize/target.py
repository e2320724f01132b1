"""Where a synthesis goes: the format that a name asks for, and room on its disk."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from ..data.writers import write_exr_folder, write_npz, write_ubo2003
from ..errors import OutputError

FLOAT_BYTES = 4
FORMATS = "expected a new name that ends in .zip (UBO2003, 8 bit), .npz, or nothing (EXR folder)"


@dataclass(frozen=True)
class Target:
    """A format to write.

    Attributes:
        hdr: whether it holds any value; else 8-bit codes of 0 to 1.
        bytes_per_value: at most, uncompressed.
        write: the writer, called with (path, btf, progress=...).
    """

    hdr: bool
    bytes_per_value: int
    write: Callable[..., None]


def target_of(output: Path, gamma: float) -> Target:
    """The format that a name asks for.

    Raises:
        OutputError: it exists, its folder does not, or its ending is unknown.
    """
    targets = {
        ".zip": Target(False, 1, partial(write_ubo2003, gamma=gamma)),
        ".npz": Target(True, FLOAT_BYTES, write_npz),
        "": Target(True, FLOAT_BYTES, write_exr_folder),
    }
    if output.exists() or output.is_symlink():
        raise OutputError(f"{output} exists; {FORMATS}; choose another name or remove it.")
    if not output.parent.is_dir():
        raise OutputError(
            f"the folder {output.parent} of {output} does not exist; {FORMATS} in an existing "
            f"folder; make it first."
        )
    if output.suffix.lower() not in targets:
        raise OutputError(f"{output} has an unknown ending; {FORMATS}.")
    return targets[output.suffix.lower()]


def hidden_folder(output: Path, needed: int) -> TemporaryDirectory[str]:
    """A folder beside the output that is removed in the end.

    Raises:
        OutputError: it cannot be made, or the disk has no room for `needed` bytes.
    """
    try:
        free = shutil.disk_usage(output.parent).free
        if free < needed:
            # Before rendering, because a mapped file on a full disk kills the process.
            raise OutputError(
                f"{output} and its pictures need up to {needed / 1e9:.3g} GB of disk but "
                f"{output.parent} has {free / 1e9:.3g} GB; free some, or use a smaller --size."
            )
        return TemporaryDirectory(prefix=f".{output.name}.", suffix=".part", dir=output.parent)
    except OSError as error:
        raise OutputError(
            f"{output} cannot be written ({error}); expected a writable folder; choose another."
        ) from error
