"""Cut a rectangle out of a UBO2003 BTF without decoding loss worth the name.

The bundled sample was made by
`spmm crop WEAVE64.zip WEAVE40.zip --x 0 --y 0 --width 40 --height 40`.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path, PurePosixPath

from PIL import Image, JpegImagePlugin

from ..errors import DataError
from ..runtime.atomic import new_file, zip_member
from .codecs import DECODE_ERRORS
from .picture_set import list_pictures
from .pictures import open_archive, unreadable

# JPEG codes blocks of 8 x 8 samples; with subsampled colour a unit covers 16 x 16 pixels.
BLOCK = 8
SUBSAMPLED_BLOCK = 16
FULL_COLOUR = 0  # Pillow's number for 4:4:4

Box = tuple[int, int, int, int]  # left, top, right, bottom


def crop_ubo2003(
    source: Path | str, x0: int, y0: int, width: int, height: int, destination: Path | str
) -> None:
    """Write the texels `[y0 : y0 + height, x0 : x0 + width]` of every picture to a zip.

    Pictures are re-encoded in YCbCr with their own quantization tables; along block borders
    this repeats the source's coefficients, up to rounding.

    Raises:
        DataError: no pictures, not JPEG, or a rectangle outside them or across JPEG blocks.
        OutputError: the zip cannot be written.
    """
    path, target = Path(source), Path(destination)
    names = list_pictures(path)
    if not names:
        raise DataError(f"{path} holds no UBO2003 pictures; nothing to crop.")
    box = (x0, y0, x0 + width, y0 + height)
    with (
        open_archive(path) as archive,
        new_file(target) as temporary,
        zipfile.ZipFile(temporary, "w") as output,
    ):
        for name in names:
            try:
                picture = crop_jpeg(archive.read([name])[0], box, name)
            except DECODE_ERRORS as error:
                raise unreadable(path, name, error) from error
            output.writestr(zip_member(_renamed(name, target.stem)), picture)


def crop_jpeg(payload: bytes, box: Box, name: str) -> bytes:
    """A JPEG cropped along its blocks, tables and colour sampling kept; messages call it `name`."""
    with Image.open(io.BytesIO(payload)) as image:
        if image.format != "JPEG":
            raise DataError(f"picture {name!r} is {image.format}; expected JPEG; convert it first.")
        sampling = JpegImagePlugin.get_sampling(image)
        _check_box(box, image.size, BLOCK if sampling == FULL_COLOUR else SUBSAMPLED_BLOCK)
        tables = image.quantization
        image.draft("YCbCr", image.size)  # spares the way to RGB and back
        cropped = image.crop(box)
    buffer = io.BytesIO()
    cropped.save(buffer, "JPEG", qtables=tables, subsampling=sampling, optimize=True)
    return buffer.getvalue()


def _check_box(box: Box, size: tuple[int, int], block: int) -> None:
    left, top, right, bottom = box
    inside = 0 <= left < right <= size[0] and 0 <= top < bottom <= size[1]
    if not inside or any(edge % block for edge in box):
        raise DataError(
            f"the rectangle x {left}..{right}, y {top}..{bottom} does not fit pictures of "
            f"{size[0]} x {size[1]}; expected edges inside them at multiples of {block}."
        )


def _renamed(name: str, root: str) -> str:
    """The member's name under a new top folder."""
    parts = PurePosixPath(name).parts
    return str(PurePosixPath(root, *(parts[1:] if len(parts) > 1 else parts)))
