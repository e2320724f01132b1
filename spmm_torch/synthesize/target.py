"""The target of a synthesis: its format, by the suffix, and the space on its disk."""

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
    """A format of the output.

    Attributes:
        hdr: whether it holds values of any size; else 8-bit codes of 0 to 1.
        bytes_per_value: largest number of bytes of a value, uncompressed.
        write: writer, called with (path, btf, progress=...).
    """

    hdr: bool
    bytes_per_value: int
    write: Callable[..., None]


def target_of(output: Path, gamma: float) -> Target:
    """The format of an output, by its suffix; `gamma` is the display gamma of a zip.

    Raises:
        OutputError: the output exists, its folder does not, or its suffix is unknown.
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
    """A hidden temporary folder beside the output.

    Raises:
        OutputError: the folder cannot be made, or the disk lacks space for `needed` bytes.
    """
    try:
        free = shutil.disk_usage(output.parent).free
        if free < needed:
            # Checked before rendering, as a mapped file on a full disk kills the process.
            raise OutputError(
                f"{output} and its pictures need up to {needed / 1e9:.3g} GB of disk but "
                f"{output.parent} has {free / 1e9:.3g} GB; free some, or use a smaller --size."
            )
        return TemporaryDirectory(prefix=f".{output.name}.", suffix=".part", dir=output.parent)
    except OSError as error:
        raise OutputError(
            f"{output} cannot be written ({error}); expected a writable folder; choose another."
        ) from error
