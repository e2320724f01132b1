"""BTF data: one lazy texel-major `BTF`, and one module or package for each file format.

A reader is a module with `accepts(path) -> bool`, which judges by content and not by extension,
and `read(path, options) -> BTF`. A new format = one module and one entry in `READERS`.
"""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from ..config.fit import DataConfig
from ..errors import DataError
from . import npz, picture_set, ubo2014
from .btf import BTF
from .options import DEFAULT_OPTIONS, ReadOptions
from .selection import Selection, select_part
from .store import Progress
from .writers import write_npz

__all__ = [
    "BTF",
    "READERS",
    "Progress",
    "ReadOptions",
    "Selection",
    "load_btf",
    "load_input",
    "sample_path",
    "select_part",
    "write_npz",
]

READERS: tuple[ModuleType, ...] = (ubo2014, npz, picture_set)
SAMPLE_NAME = "WEAVE40.zip"
EXPECTED = (
    "expected a zip or folder of JPEG, PNG, Radiance or OpenEXR pictures named by their angles "
    "(like '00008 tl000 pl000 tv030 pv030.jpg'), a UBO2014 .btf, or an NPZ with values, view and "
    "light"
)


def load_btf(
    path: Path | str,
    options: ReadOptions = DEFAULT_OPTIONS,
    *,
    selection: Selection | None = None,
    seed: int = 0,
    **changes: Any,
) -> BTF:
    """Open a BTF of any known format; its values are decoded at first use.

    Args:
        path: a zip, folder, `.btf` or NPZ.
        options: how to read it.
        selection: the part to take; all of it by default.
        seed: of the choice of texels, where a selection asks for a number of them.
        changes: fields of `ReadOptions` that differ from `options`: `load_btf(path, gamma=1.0)`.

    Raises:
        DataError: nothing there, no known format, or malformed.
        ConfigError: an option out of its range.
    """
    btf = _read(path, replace(options, **changes))
    return btf if selection is None else select_part(btf, selection, seed)


def load_input(path: Path | str, settings: DataConfig, seed: int = 0) -> BTF:
    """The part of a BTF that the settings of a fit name, read as they say.

    Raises:
        DataError: nothing there, no known format, malformed, or without that part.
    """
    options, selection = ReadOptions.of(settings), Selection.of(settings)
    return load_btf(path, options, selection=selection, seed=seed)


def _read(path: Path | str, options: ReadOptions) -> BTF:
    source = Path(path)
    if not source.exists():
        raise DataError(f"{path} does not exist; {EXPECTED}; check the path.")
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
            f"{path} cannot be read ({error}); {EXPECTED}; check its permissions."
        ) from error
    raise DataError(f"{path} {_complaint(source)}; {EXPECTED}; check that it is the right one.")


def _complaint(path: Path) -> str:
    """Why no reader accepts a path that exists."""
    if path.is_dir():
        return "is an empty folder" if not any(path.iterdir()) else "holds no BTF pictures"
    if zipfile.is_zipfile(path):
        return "is a zip without BTF pictures"
    return "is neither a complete zip nor a folder nor a .btf"


def sample_path() -> Path:
    """The bundled sample: 40 x 40 texels of a path-traced plain weave, UBO2003 format."""
    return Path(__file__).parent / "sample" / SAMPLE_NAME
