"""Writer of UBO2003 zips: one 8-bit picture for each direction pair, named by its angles."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ...config.schema import setting
from ...errors import ConfigError, OutputError
from ...runtime.atomic import new_file, zip_member
from ..options import DISPLAY_GAMMA, ReadOptions
from .base import Writer
from .names import picture_names
from .views import pictures_of_views

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

SUFFIXES = {"jpeg": ".jpg", "png": ".png"}
MAX_CODE = 255
QUALITY = 95
FULL_COLOUR = 0  # Pillow's number for 4:4:4: texels keep their own colour
# Level of compression: higher ones take five times as long and hardly shrink measured textures.
PNG_LEVEL = 1


@dataclass(frozen=True)
class Ubo2003Settings:
    """The options of a UBO2003 zip."""

    gamma: float = setting(
        DISPLAY_GAMMA,
        "display gamma: exponent that turns 8-bit codes into linear values",
        low=0.01,
        high=10.0,
    )
    png: bool = setting(
        False, "whether pictures are PNG, which is lossless, in place of JPEG (zip only)"
    )
    quality: int = setting(QUALITY, "quality of JPEG pictures (zip only)", low=1, high=100)


def write_ubo2003(
    path: Path | str,
    btf: BTF,
    gamma: float = DISPLAY_GAMMA,
    format: str = "jpeg",
    quality: int = QUALITY,
    progress: Progress | None = None,
) -> None:
    """Writes a BTF as a UBO2003 zip; a failure leaves nothing.

    The same BTF gives the same bytes. The PNGs of a BTF that was read from 8-bit pictures with the
    same `gamma` have the same codes.

    Args:
        path: zip to write; the folder inside has its name.
        btf: BTF with values in 0 to 1.
        gamma: exponent that turns the codes back into linear values.
        format: "jpeg" (4:4:4) or "png".
        quality: quality of JPEGs, 1 to 100.
        progress: called with (views done, V) after each view.

    Raises:
        ConfigError: an option is out of its range.
        OutputError: a value does not fit into 8 bits, or the file cannot be written.
    """
    ReadOptions(gamma=gamma)  # refuses a gamma that no reader accepts
    _check_options(format, quality)
    target = Path(path)
    # A leading dot would hide the folder from the reader.
    folder = f"{target.stem.lstrip('.') or 'BTF'}/MANYFILES"
    names = picture_names(btf.view, btf.light, SUFFIXES[format])
    with new_file(target) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for row, pictures in zip(names, pictures_of_views(btf, progress), strict=True):
            for name, picture in zip(row, pictures, strict=True):
                payload = _encode(_codes(picture, gamma, name), format, quality)
                archive.writestr(zip_member(f"{folder}/{name}"), payload)


def write(
    path: Path | str, btf: BTF, settings: Ubo2003Settings, progress: Progress | None = None
) -> None:
    """Writes a BTF as a UBO2003 zip; see `write_ubo2003`."""
    pictures = "png" if settings.png else "jpeg"
    write_ubo2003(path, btf, settings.gamma, pictures, settings.quality, progress)


WRITER = Writer("ubo2003", "zip of pictures (UBO2003)", ".zip", "views", Ubo2003Settings, write)


def _check_options(format: str, quality: int) -> None:
    if format not in SUFFIXES:
        raise ConfigError(f"format is {format!r}; expected one of {', '.join(SUFFIXES)}.")
    if not 1 <= quality <= 100:
        raise ConfigError(f"quality is {quality}; expected 1 to 100.")


def _codes(picture: np.ndarray, gamma: float, name: str) -> np.ndarray:
    """The nearest 8-bit codes of linear values `[H, W, 3]`."""
    exact = np.sign(picture) * np.abs(picture) ** (1.0 / gamma) * MAX_CODE
    codes = np.rint(exact)
    if not ((codes >= 0) & (codes <= MAX_CODE)).all():
        raise OutputError(
            f"picture {name!r} would hold values from {picture.min():g} to {picture.max():g}; "
            f"expected 0 to 1, as 8 bits hold; write EXR or NPZ instead."
        )
    return codes.astype(np.uint8)


def _encode(codes: np.ndarray, format: str, quality: int) -> bytes:
    """A picture file of codes `[H, W, 3]`."""
    buffer = io.BytesIO()
    image = Image.fromarray(codes)
    if format == "png":
        image.save(buffer, "PNG", compress_level=PNG_LEVEL)
    else:
        image.save(buffer, "JPEG", quality=quality, subsampling=FULL_COLOUR)
    return buffer.getvalue()
