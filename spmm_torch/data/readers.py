"""Readers of BTFs: one module or package for each file format, with the names of `Reader`.

A new format is one module and one line in `NAMES`.
"""

from __future__ import annotations

import zipfile
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from ..config.fit import DataConfig
from ..errors import DataError, alternatives
from .btf import BTF
from .options import DEFAULT_OPTIONS, ReadOptions
from .selection import Selection, select_part

# The first reader in this order that accepts a path reads it.
NAMES = (
    "ubo2014",
    "scattered",
    "npz",
    "brdf_tables",
    "picture_set",
)
SAMPLE_NAME = "WEAVE40.zip"


class Reader(Protocol):
    """The names in the module of a reader."""

    @property
    def EXPECTED(self) -> str:  # noqa: N802
        """Its format in words that fit into "expected A, B or C"."""
        ...

    def accepts(self, path: Path) -> bool:
        """Whether a file or folder has this format, by its content rather than its name."""
        ...

    def read(self, path: Path | str, options: ReadOptions) -> BTF:
        """The BTF at a path; reads only headers, as values are decoded at first use.

        Raises:
            DataError: the data are malformed; one sentence says what, where and what to do.
        """
        ...


READERS: tuple[Reader, ...] = tuple(
    cast("Reader", import_module(f".{name}", __package__)) for name in NAMES
)


def load_btf(
    path: Path | str,
    options: ReadOptions = DEFAULT_OPTIONS,
    *,
    selection: Selection | None = None,
    seed: int = 0,
    **changes: Any,
) -> BTF:
    """Opens a BTF of any known format; its values are decoded at first use.

    Args:
        path: a zip, folder, `.btf` or NPZ file.
        options: options of the reader.
        selection: part to take; None: all of it.
        seed: seed of the random choice of texels, if the selection has a number of them.
        changes: fields of `options` to change, as in `load_btf(path, gamma=1.0)`.

    Raises:
        DataError: there is nothing, of no known format, malformed, or without the selected part.
        ConfigError: an option or the selection is malformed or out of its range.
    """
    btf = _read(path, replace(options, **changes))
    return btf if selection is None else select_part(btf, selection, seed)


def load_input(path: Path | str, settings: DataConfig, seed: int = 0) -> BTF:
    """The BTF at a path, or a part of it, as the settings of a fit say.

    Raises:
        DataError: there is nothing, of no known format, malformed, or without that part.
        ConfigError: a setting is malformed.
    """
    options, selection = ReadOptions.of(settings), Selection.of(settings)
    return load_btf(path, options, selection=selection, seed=seed)


def sample_path() -> Path:
    """The path of the bundled sample, 40 x 40 texels of a path-traced plain weave (UBO2003)."""
    return Path(__file__).parent / "sample" / SAMPLE_NAME


def _read(path: Path | str, options: ReadOptions) -> BTF:
    source = Path(path)
    if not source.exists():
        raise DataError(f"{path} does not exist; {_expected()}; check the path.")
    try:
        for reader in READERS:
            if reader.accepts(source):
                btf = reader.read(path, options)
                missing = {"auto": btf.cosine_missing, "included": False, "missing": True}
                return replace(
                    btf, cosine_missing=missing[options.cosine], negative=options.negative
                )
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error}); {_expected()}; check its permissions."
        ) from error
    raise DataError(f"{path} {_complaint(source)}; {_expected()}; check that it is the right one.")


def _expected() -> str:
    return f"expected {alternatives([reader.EXPECTED for reader in reversed(READERS)])}"


def _complaint(path: Path) -> str:
    """The reason why no reader accepts a path that exists."""
    if path.is_dir():
        return "is an empty folder" if not any(path.iterdir()) else "holds no BTF pictures"
    if zipfile.is_zipfile(path):
        return "is a zip without BTF pictures"
    return "is neither a complete zip nor a folder, nor a file of another known format"
