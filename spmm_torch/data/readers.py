"""Readers of BTFs: one module or package for each file format, with the names of `Reader`.

A new format is one module and one line in `NAMES`.
"""

from __future__ import annotations

import zipfile
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from ..config.fit import DataConfig
from ..errors import ConfigError, DataError, alternatives
from ..runtime.device import plain_torch
from ..runtime.foreign import absence, foreign_file
from . import picture_set
from .btf import BTF
from .codecs import SUFFIXES
from .left_out import PACKED, left_out_notes
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import is_container, list_files, shown
from .selection import Selection, select_part

# The first reader in this order that accepts a path reads it.
NAMES = (
    "ubo2014",
    "scattered",
    "npz",
    "brdf_tables",
    "picture_set",
    "rti",
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


@plain_torch()
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
        path: a zip, folder, `.btf`, NPZ or `.lp` file.
        options: options of the reader.
        selection: part to take; None: all of it.
        seed: seed of the random choice of texels, if the selection has a number of them.
        changes: fields of `options` to change, as in `load_btf(path, gamma=1.0)`.

    Raises:
        DataError: there is nothing, of no known format, malformed, or without the selected part.
        ConfigError: an option or the selection is malformed or out of its range.
    """
    options = replace(options, **changes)
    btf = replace(_read(path, options), read_as=options.settings())
    if selection is None:
        return btf
    return replace(select_part(btf, selection, seed), read_as=selection.added_to(btf.read_as))


def load_input(path: Path | str, settings: DataConfig, seed: int = 0) -> BTF:
    """The BTF at a path, or a part of it, as the settings of a fit say.

    Raises:
        DataError: there is nothing, of no known format, malformed, or without that part.
        ConfigError: a setting is malformed.
    """
    options, selection = ReadOptions.of(settings), Selection.of(settings)
    return load_btf(path, options, selection=selection, seed=seed)


def obeying(btf: BTF, settings: DataConfig, seed: int = 0) -> BTF:
    """A BTF as the settings of a fit ask for it, however it was opened; else the BTF itself.

    A setting at its default asks for nothing. Gamma, gaps, names, rings and rows concern files
    alone.

    Args:
        btf: opened by `load_btf`, made from values, or a part of such.
        settings: of the fit.
        seed: seed of the random choice of texels.

    Raises:
        ConfigError: a part is asked for, and the BTF is another part already.
        DataError: the file is gone or changed, or has no such part.
    """
    asked = _asked(btf.read_as, settings)
    if {"gamma", "missing", "pattern", "rings", "rows"} & asked.keys() and btf.path:
        options = ReadOptions.of(replace(btf.read_as, **asked))
        btf = _same_part(load_btf(btf.path, options), btf)
    if "negative" in asked:
        btf = replace(btf, negative=settings.negative)
    if "cosine" in asked:
        btf = replace(btf, cosine_missing=settings.cosine == "missing")
    parts = sorted({"crop", "texels", "directions"} & asked.keys())
    if not parts:
        return btf
    if not btf.part.is_whole:
        raise ConfigError(
            f"data.{parts[0]} is {asked[parts[0]]!r} in the settings of this fit, but the BTF is a "
            f"part of {btf.name} already; expected one of the two; take all of it by load_btf, or "
            f"leave data.{parts[0]} out."
        )
    return select_part(btf, Selection.of(settings), seed)


def sample_path() -> Path:
    """The path of the bundled sample, 40 x 40 texels of a path-traced plain weave (UBO2003)."""
    return Path(__file__).parent / "sample" / SAMPLE_NAME


def _asked(read_as: DataConfig, settings: DataConfig) -> dict[str, Any]:
    """The settings that are not at their default, and by which a BTF was not read."""
    default = DataConfig()
    names = [item.name for item in fields(DataConfig)]
    return {
        name: value
        for name in names
        if (value := getattr(settings, name))
        not in (getattr(default, name), getattr(read_as, name))
    }


def _same_part(whole: BTF, other: BTF) -> BTF:
    """The part of a whole BTF that another one of the same source is."""
    if other.part.is_whole:
        return whole
    part, size = other.part, (other.height, other.width)
    return whole.restricted(part.texels, size, views=part.views, lights=part.lights)


def _read(path: Path | str, options: ReadOptions) -> BTF:
    source = Path(path)
    if (reason := absence(source)) is not None:
        raise DataError(f"{path} {reason}; {_expected()}; check the path.")
    try:
        reader = _reader_of(source, options)
        if reader is None and source.is_dir() and (inner := _only_btf_in(source)) is not None:
            btf = _read(source / inner, options)
            notes = left_out_notes(source, list_files(source), [inner])
            return replace(btf, notes=btf.notes + notes)
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error}); {_expected()}; check its permissions."
        ) from error
    if reader is None:
        raise DataError(f"{path} {_complaint(source)}; {_expected()}; {_remedy(source)}.")
    btf = reader.read(path, options)
    missing = {"auto": btf.cosine_missing, "included": False, "missing": True}
    return replace(btf, cosine_missing=missing[options.cosine], negative=options.negative)


def _reader_of(path: Path, options: ReadOptions) -> Reader | None:
    """The reader of a file or folder; a pattern of names makes any zip or folder a picture set."""
    for reader in READERS:
        named = reader is picture_set and options.pattern is not None
        if reader.accepts(path) or (named and is_container(path)):
            return reader
    return None


def _only_btf_in(folder: Path) -> str | None:
    """The name of the one BTF that lies in a folder; None if there is none.

    Raises:
        DataError: there are several.
    """
    names = [
        name
        for name in shown(list_files(folder))
        if any(reader.accepts(folder / name) for reader in READERS)
    ]
    if len(names) > 1:
        raise DataError(
            f"{folder} holds {len(names)} BTFs, {names[0]!r} and {names[1]!r} among them; expected "
            f"one; give the path of one of them."
        )
    return names[0] if names else None


def _expected() -> str:
    return f"expected {alternatives([reader.EXPECTED for reader in reversed(READERS)])}"


def _complaint(path: Path) -> str:
    """The reason why no reader accepts a path that exists."""
    if path.is_dir():
        return "is an empty folder" if not any(path.iterdir()) else "holds no BTF pictures"
    if zipfile.is_zipfile(path):
        return "is a zip without BTF pictures"
    if kind := foreign_file(path):
        return f"is {kind.what}"
    return "is neither a complete zip nor a folder, nor a file of another known format"


def _remedy(path: Path) -> str:
    """What to do about a path that no reader accepts."""
    if kind := foreign_file(path):
        return kind.remedy
    files = list_files(path) if is_container(path) else []
    if packed := [name for name in files if name.lower().endswith(PACKED)]:
        return f"unpack {packed[0]!r} and give that"
    if any(name.lower().endswith(SUFFIXES) for name in files):
        return "check that it is the right one, or give the pattern of its names with --pattern"
    return "check that it is the right one"
