"""BTF data: one lazy texel-major `BTF`, and one module or package for each file format.

A reader is a module with `accepts(path) -> bool`, which judges by content and not by extension,
and `read(path, options) -> BTF`. A new format = one module and one entry in `READERS`.
"""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from ..errors import DataError
from . import npz, picture_set, ubo2014
from .btf import BTF
from .options import DISPLAY_GAMMA, ReadOptions
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
    *,
    gamma: float = DISPLAY_GAMMA,
    threads: int = 0,
    cosine: str = "auto",
    negative: str = "refuse",
    missing: str = "refuse",
    selection: Selection | None = None,
    seed: int = 0,
) -> BTF:
    """Open a BTF of any known format; its values are decoded at first use.

    Args:
        path: a zip, folder, `.btf` or NPZ.
        gamma: exponent that makes 8-bit codes linear; 1.0 if they are linear already.
        threads: how many pictures are decoded at once; 0 = one for each core.
        cosine: of the light: "included" in the values, "missing", or "auto": as a `.btf` says of
            itself, included in all others.
        negative: of values below zero, such as noise after dark-frame subtraction: "refuse" them,
            "clip" them to zero, or "keep" them.
        missing: pairs of directions without a picture: "refuse" them, or "mask" them; pictures
            only.
        selection: the part to take; all of it by default.
        seed: of the choice of texels, where a selection asks for a number of them.

    Raises:
        DataError: nothing there, no known format, or malformed.
        ConfigError: an option out of its range.
    """
    options = ReadOptions(
        gamma=gamma, threads=threads, cosine=cosine, negative=negative, missing=missing
    )
    btf = _read(path, options)
    return btf if selection is None else select_part(btf, selection, seed)


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
