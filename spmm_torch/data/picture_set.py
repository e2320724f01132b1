"""Reader of UBO2003: a zip or folder of one 8-bit picture for each pair of directions.

The names tell the directions: `<NAME>/MANYFILES/tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`
holds the polar angles t and azimuths p, in degrees, of light l and view v. The pictures are
gamma-encoded and already multiplied by the cosine of the light.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from ..errors import DataError
from .btf import BTF
from .directions import checked_directions
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import (
    Archive,
    PictureGrid,
    arrange,
    list_files,
    material_name,
    open_archive,
    parse_angles,
    unit_vectors,
    unreadable,
)
from .store import ArrayStore, Progress, check_not_black, gamma_table

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm")
# Grey pictures become RGB; other modes have no plain meaning as reflectance.
MODES = frozenset({"RGB", "L"})
DECODE_ERRORS = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


def accepts(path: Path) -> bool:
    """Whether a folder or zip holds at least one picture named by its directions."""
    return (path.is_dir() or zipfile.is_zipfile(path)) and any(map(_is_picture, list_files(path)))


def list_pictures(path: Path) -> list[str]:
    """Names of all 8-bit pictures in a zip or folder that tell their directions."""
    return [name for name in list_files(path) if _is_picture(name)]


def _is_picture(name: str) -> bool:
    return name.lower().endswith(SUFFIXES) and parse_angles(name) is not None


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Open a UBO2003 zip or folder: scans the names and one header, decodes nothing.

    Raises:
        DataError: a pair of directions is missing or doubled, or the first picture is broken.
    """
    source = Path(path)
    grid = arrange(list_pictures(source), source)
    with open_archive(source) as archive:
        height, width = _size(archive, grid.files[0], source)
    return BTF(
        name=material_name(source),
        path=str(path),
        height=height,
        width=width,
        view=checked_directions(unit_vectors(grid.view), f"the set of views in {source}"),
        light=checked_directions(unit_vectors(grid.light), f"the set of lights in {source}"),
        bytes_per_value=1,
        open_store=partial(_open_store, source, grid, (height, width), options),
    )


def _size(archive: Archive, name: str, path: Path) -> tuple[int, int]:
    (payload,) = archive.read([name])
    try:
        with Image.open(io.BytesIO(payload)) as image:
            return image.height, image.width
    except DECODE_ERRORS as error:
        raise unreadable(path, name, error) from error


def _open_store(
    path: Path,
    grid: PictureGrid,
    size: tuple[int, int],
    options: ReadOptions,
    progress: Progress | None,
) -> ArrayStore:
    """Decode all pictures into texel-major codes `[T, D, 3]` uint8, a view to a task."""
    view_count, light_count = len(grid.view), len(grid.light)
    codes = np.empty((size[0] * size[1], len(grid.files), 3), dtype=np.uint8)  # [T, D, 3]
    brightest = 0

    with open_archive(path) as archive, ThreadPoolExecutor(options.thread_count) as pool:

        def decode_view(view: int) -> int:
            pairs = slice(view * light_count, (view + 1) * light_count)
            pictures = decode(archive, grid.files[pairs], size, path)  # [L, T, 3]
            transpose_into(codes[:, pairs], pictures)
            return int(pictures.max())

        for view, maximum in enumerate(pool.map(decode_view, range(view_count))):
            brightest = max(brightest, maximum)
            if progress is not None:
                progress(view + 1, view_count)

    check_not_black(brightest, str(path))
    return ArrayStore(torch.from_numpy(codes), gamma_table(options.gamma), is_hdr=False)


def decode(archive: Archive, names: Sequence[str], size: tuple[int, int], path: Path) -> np.ndarray:
    """Pictures `[N, H * W, 3]` uint8 of the given files.

    Raises:
        DataError: names the file that is broken, of another size or of another mode.
    """
    pictures = np.empty((len(names), *size, 3), dtype=np.uint8)  # [N, H, W, 3]
    for picture, name, payload in zip(pictures, names, archive.read(names), strict=True):
        try:
            with Image.open(io.BytesIO(payload)) as image:
                _check_picture(image, size, name, path)
                image.load()  # here, so that a truncated file raises its own error
                picture[...] = image if image.mode == "RGB" else image.convert("RGB")
        except DECODE_ERRORS as error:
            raise unreadable(path, name, error) from error
    return pictures.reshape(len(names), -1, 3)


def _check_picture(image: Image.Image, size: tuple[int, int], name: str, path: Path) -> None:
    if (image.height, image.width) != size:
        raise DataError(
            f"picture {name!r} in {path} is {image.width} x {image.height}; expected "
            f"{size[1]} x {size[0]} like the first one; all pictures must be registered texel "
            f"by texel: replace or rescale this one."
        )
    if image.mode not in MODES:
        raise DataError(
            f"picture {name!r} in {path} has mode {image.mode}; expected 8-bit RGB or grey; "
            f"convert it to RGB."
        )


def transpose_into(target: np.ndarray, pictures: np.ndarray) -> None:
    """Write pictures `[N, T, 3]` to `target [T, N, 3]`, a whole texel of 3 bytes at a time."""
    target.view("V3")[..., 0] = pictures.view("V3")[..., 0].T
