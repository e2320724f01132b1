"""Crop of a UBO2003 BTF, whose JPEGs lose next to nothing.

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
from .codecs.arrangement import ORIENTATION_TAG, TURNS
from .named_pictures import list_pictures
from .pictures import open_archive, unreadable

# Pixels along a block of JPEG: 8, or 16 where colour is subsampled.
BLOCK = 8
SUBSAMPLED_BLOCK = 16
FULL_COLOUR = 0  # Pillow's number for 4:4:4

Box = tuple[int, int, int, int]  # left, top, right, bottom


def crop_ubo2003(
    source: Path | str,
    x0: int,
    y0: int,
    width: int,
    height: int,
    destination: Path | str,
    *,
    pattern: str | None = None,
) -> None:
    """Writes the texels `[y0 : y0 + height, x0 : x0 + width]` of every picture to a zip.

    Pictures are encoded again in YCbCr with their own quantization tables. As the rectangle follows
    the blocks of JPEG, this repeats the coefficients of the source, up to rounding.

    Args:
        source: zip or folder of the pictures.
        x0, y0, width, height: the rectangle.
        destination: zip to write.
        pattern: how pictures are named; None: each angle behind its letters.

    Raises:
        DataError: there are no pictures, they are not JPEG, or the rectangle is outside of them or
            cuts their blocks.
        OutputError: the zip cannot be written.
    """
    path, target = Path(source), Path(destination)
    names = list_pictures(path, pattern)
    if not names:
        raise DataError(
            f"{path} holds no pictures that are named by their directions; expected names such as "
            f"those of UBO2003; tell by --pattern how they are named."
        )
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
    """The crop of a JPEG along its blocks, with the same quantization and colour sampling.

    Args:
        payload: bytes of the JPEG.
        box: (left, top, right, bottom) in pixels.
        name: name of the picture in messages.

    Raises:
        DataError: the picture is not JPEG, or turned by a tag, or the box is outside of it or cuts
            its blocks.
    """
    with Image.open(io.BytesIO(payload)) as image:
        if image.format != "JPEG" or not isinstance(image, JpegImagePlugin.JpegImageFile):
            raise DataError(f"picture {name!r} is {image.format}; expected JPEG; convert it first.")
        if image.getexif().get(ORIENTATION_TAG) in TURNS:
            raise DataError(
                f"picture {name!r} is turned by its EXIF tag; expected upright pixels, whose "
                f"blocks can be kept; turn it without loss first, as by exiftran."
            )
        sampling = JpegImagePlugin.get_sampling(image)
        _check_box(box, image.size, BLOCK if sampling == FULL_COLOUR else SUBSAMPLED_BLOCK)
        tables = image.quantization
        image.draft("YCbCr", image.size)  # avoids the conversion to RGB and back
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
    """The name of a member with another top folder."""
    parts = PurePosixPath(name).parts
    return str(PurePosixPath(root, *(parts[1:] if len(parts) > 1 else parts)))
