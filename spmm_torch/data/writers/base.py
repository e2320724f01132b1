"""What every writer is: a format's name, its options, and the function that writes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress


@dataclass(frozen=True)
class NoSettings:
    """The options of a format that has none."""


@dataclass(frozen=True)
class Writer:
    """How one format is written.

    Attributes:
        name: of the format, in one lower-case word.
        title: what help texts call it.
        suffix: of the names of such files, in lower case; empty for a folder.
        unit: what `progress` counts, "views" or "texels".
        settings: a dataclass of `config.schema.setting` fields, the options of the format.
        write: takes the path, the BTF, settings and `progress(done, total)` or None; leaves at
            the path all of the file or nothing, and raises an OutputError in one sentence.
    """

    name: str
    title: str
    suffix: str
    unit: str
    settings: type
    write: Callable[[Path | str, BTF, Any, Progress | None], None]
