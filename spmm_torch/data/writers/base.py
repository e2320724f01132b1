"""The interface of a writer: the name of a format, its options, and its function."""

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
    """The settings of a format without options."""


@dataclass(frozen=True)
class Prepared:
    """A BTF in the shape of a format that cannot hold all of it.

    Args:
        loss: what the format loses, in one line.
        write: function of the path; it leaves the whole file there or nothing.
    """

    loss: str
    write: Callable[[Path | str], None]


@dataclass(frozen=True)
class Writer:
    """The writer of one format.

    Attributes:
        name: name of the format, one lower-case word.
        title: name of the format in help texts.
        suffix: suffix of its files, in lower case; empty for a folder.
        unit: unit that `progress` counts, "views" or "texels".
        settings: dataclass of `config.schema.setting` fields, the options of the format.
        write: function of the path, the BTF, its settings and `progress(done, total)` or None. It
            leaves the whole file at the path or nothing, and raises an OutputError in one sentence.
        prepare: function of the BTF, its settings and `progress`, for a format that cannot hold all
            of a BTF: it finds out what is lost before anything is written. None: nothing is lost.
    """

    name: str
    title: str
    suffix: str
    unit: str
    settings: type
    write: Callable[[Path | str, BTF, Any, Progress | None], None]
    prepare: Callable[[BTF, Any, Progress | None], Prepared] | None = None
