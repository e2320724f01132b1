"""Writers of BTFs: one module for each format, with a `base.Writer` called `WRITER`.

A new format is one module and one line in `NAMES`. A writer reads the BTF one view at a time,
writes under a temporary name and renames at the end. Modules import torch only in functions that
write, so that formats and their options can be listed without torch.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from ...errors import ConfigError, alternatives
from .base import Writer
from .exr import write_exr_folder
from .npz import write_npz
from .ubo2003 import write_ubo2003

__all__ = [
    "WRITERS",
    "Writer",
    "write_exr_folder",
    "write_npz",
    "write_ubo2003",
    "writer_of",
]

NAMES = (
    "npz",
    "ubo2003",
    "exr",
    "ubo2014",
)
WRITERS: dict[str, Writer] = {
    writer.name: writer for writer in (import_module(f".{name}", __name__).WRITER for name in NAMES)
}


def writer_of(output: str) -> Writer:
    """The writer for the suffix of an output; no suffix stands for a folder.

    Raises:
        ConfigError: the suffix belongs to no format.
    """
    suffix = "" if output.endswith("/") else Path(output).suffix.lower()
    for writer in WRITERS.values():
        if writer.suffix == suffix:
            return writer
    known = [writer.suffix for writer in WRITERS.values() if writer.suffix]
    expected = alternatives([*known, "no suffix for a folder"])
    raise ConfigError(
        f"output {output} ends in {suffix}, which names no format; expected {expected}; choose "
        f"another name or give --format."
    )
