"""Writers of BTFs: one module for each format, whose `WRITER` says what `base.Writer` asks for.

A new format is one module and one line in `NAMES`. A writer asks the BTF for one view at a time,
writes under a temporary name and renames at the end. Modules import torch only where they write,
so that formats and their options may be listed without it.
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
    """The writer that the name of an output asks for by its suffix; none means a folder.

    Raises:
        ConfigError: its suffix belongs to no format.
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
