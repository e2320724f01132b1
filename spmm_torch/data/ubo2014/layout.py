"""Parser of UBO2014 files without their factors, which checks every count against the file size.

Source: the Bonn BTF library, and the public loaders that follow it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError, alternatives
from .colour import MODELS
from .cursor import Cursor
from .header import (
    BEFORE_CHANNELS,
    BEFORE_COSINE,
    BEFORE_XML,
    CHANNEL_NAMES,
    CHANNELS,
    DFMF,
    FMF12,
    MAGICS,
    SCALARS,
    TEXT_BYTES,
    VARIANTS,
    WITH_HEIGHT_MAP,
    WITH_LOG_VALUES,
    Factors,
    Header,
    Layout,
    Matrix,
)
from .order import TOP, split_mark
from .sampling import read_sampling

# Offset of the version if the letter R and the size of the header precede it.
VERSION_AFTER_LETTER = 5


def read_header(path: Path | str, rows: str = TOP) -> Header:
    """The header of a file, whose factors are not read.

    Args:
        path: the file.
        rows: row of the height map that comes first, as in `read_layout`.

    Raises:
        DataError: the file is not supported or damaged.
    """
    return read_layout(Path(path), rows).header


def read_layout(path: Path, rows: str = TOP) -> Layout:
    """The header of a file and the places of its factors, all checked.

    Args:
        path: the file.
        rows: row of the pictures that comes first in a file that does not tell: "top", as the
            library of the format's authors reads, or "bottom".

    Raises:
        DataError: the file is not supported or damaged, or cannot be opened.
    """
    try:
        with path.open("rb") as stream:
            return _parse(Cursor(path, stream, os.fstat(stream.fileno()).st_size), rows)
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error}); expected a UBO2014 .btf file; check that it is "
            f"still there and may be read."
        ) from error


def _parse(cursor: Cursor, rows: str) -> Layout:
    """The layout of a file from its first to its last byte."""
    variant = _variant(cursor)
    with_rotations = _has_rotations(cursor)
    if with_rotations:
        cursor.skip(1, "the letter R")
    fields = {"variant": variant} | _description(cursor) | read_sampling(cursor)
    if with_rotations:
        fields["rotations"] = _rotations(cursor)
    rows = fields["rows"] or rows
    if variant == DFMF:
        header = Header(**fields, **_colour_model(cursor))
        factors = _channel_factors(cursor, header)
    else:
        header = Header(**fields, **(_extension(cursor, rows) if variant == FMF12 else {}))
        factors = _shared_factors(cursor, header)
    cursor.finish()
    return Layout(header, factors, rows)


def _variant(cursor: Cursor) -> str:
    """The name of the variant, by the first bytes."""
    start = cursor.peek(max(map(len, MAGICS)))
    for name in VARIANTS:
        if start.startswith(f"!{name}".encode()):
            cursor.skip(len(name) + 1, "the magic")
            return name
    raise cursor.error(
        f"starts with {start!r}, a kind that is not supported,",
        0,
        " or ".join(f"!{name}" for name in VARIANTS),
    )


def _has_rotations(cursor: Cursor) -> bool:
    """Whether the letter R follows, which announces rotations.

    Without it the size of the header follows, whose first byte may also be an R. The byte five
    positions later decides: after a letter R it is the first byte of the version, which is not
    zero; otherwise it is the second byte of the version, which is zero.
    """
    following = cursor.peek(VERSION_AFTER_LETTER + 1)
    return following[:1] == b"R" and following[VERSION_AFTER_LETTER:] != b"\0"


def _description(cursor: Cursor) -> dict[str, Any]:
    """The fields of the description, which begins with its own size."""
    start = cursor.position
    size = cursor.integer("<u4", "the size of the header")
    version = cursor.integer("<u4", "the version of the header")
    fields: dict[str, Any] = {"version": version, "cosine": None, "rows": None}
    for key in ("setup", "sensor", "light_source"):
        fields[key] = cursor.text(TEXT_BYTES, f"the text {key!r}")
    fields["pixels_per_mm"] = float(cursor.array("<f4", 1, "the resolution")[0])
    fields["rgb_scale"] = tuple(cursor.array("<f4", CHANNELS, "the scale of RGB").tolist())
    if version > BEFORE_COSINE:
        fields["cosine"] = cursor.integer("<u4", "the cosine flag") != 0
    if version > BEFORE_XML:
        length = cursor.integer("<u4", "the length of the XML")
        fields["xml"], fields["rows"] = split_mark(cursor.text(length, "the XML"))
    if version > BEFORE_CHANNELS:
        fields["channel_names"] = _channel_names(cursor)
    if cursor.position - start != size:
        raise cursor.error(
            f"has a header of {cursor.position - start} bytes that gives its size as {size}",
            start,
            "the two to agree",
        )
    return fields


def _channel_names(cursor: Cursor) -> tuple[str, ...]:
    """The names of the channels, of which there must be three."""
    offset = cursor.position
    count = cursor.integer("<u4", "the number of channels")
    if count != CHANNELS:
        raise cursor.error(f"has {count} channels", offset, f"{CHANNELS}: {CHANNEL_NAMES}")
    names = []
    for _ in range(count):
        length = cursor.integer("<u4", "the length of a channel's name")
        names.append(cursor.text(length, "a channel's name"))
    return tuple(names)


def _rotations(cursor: Cursor) -> np.ndarray:
    """The rotations `[n, 3, 3]`."""
    count = cursor.integer("<u4", "the number of rotations")
    return cursor.array("<f4", count * 9, "the rotations").reshape(count, 3, 3)


def _colour_model(cursor: Cursor) -> dict[str, Any]:
    """The fields that only DFMF08FC has."""
    cursor.integer("<u4", "the number of components")  # each channel has its own
    offset = cursor.position
    model = cursor.integer("<u4", "the colour model")
    if model not in MODELS:
        known = [f"{number} ({words})" for number, words in MODELS.items()]
        raise cursor.error(f"has colour model {model}", offset, alternatives(known))
    return {
        "colour_model": model,
        "colour_mean": tuple(cursor.array("<f4", 3, "the mean colour").tolist()),
        "colour_transform": cursor.array("<f4", 9, "the colour transform").reshape(3, 3),
    }


def _extension(cursor: Cursor, rows: str) -> dict[str, Any]:
    """The fields that only FMF12FCE has; `rows` is the order of the rows of pictures."""
    offset = cursor.position
    version = cursor.integer("<u1", "the version of the extension")
    if version > WITH_HEIGHT_MAP:
        raise cursor.error(f"has extension version {version}", offset, f"{WITH_HEIGHT_MAP} at most")
    fields: dict[str, Any] = {}
    if version >= WITH_LOG_VALUES:
        fields["log_values"] = cursor.integer("<u4", "the flag of log values") != 0
    if version >= WITH_HEIGHT_MAP:
        width = cursor.integer("<u4", "the width of the height map")
        height = cursor.integer("<u4", "the height of the height map")
        if width * height > 0:
            codes = cursor.array("<u2", width * height, "the height map").reshape(height, width)
            codes = codes if rows == TOP else codes[::-1]
            fields["height_map"] = np.ascontiguousarray(codes, dtype=np.uint16)
    return fields


def _channel_factors(cursor: Cursor, header: Header) -> tuple[Factors, ...]:
    """The factors of DFMF08FC, one pair for each channel, all of one type of number."""
    factors = []
    for name in header.channel_names:
        offset = cursor.position
        dtype = _scalar(cursor)
        if factors and dtype != factors[0].right.dtype:
            raise cursor.error(
                f"holds numbers of {dtype.itemsize} bytes for channel {name!r}",
                offset,
                f"{factors[0].right.dtype.itemsize} as for the first channel",
            )
        components = cursor.count("components")
        factors.append(_factors(cursor, header, components, dtype))
    return tuple(factors)


def _shared_factors(cursor: Cursor, header: Header) -> tuple[Factors]:
    """The factors of FMF06FC and FMF12FCE, one pair for all channels."""
    most = cursor.count("components")
    dtype = _scalar(cursor)
    components = min(most, cursor.count("components"))
    return (_factors(cursor, header, components, dtype),)


def _scalar(cursor: Cursor) -> np.dtype:
    """The type of the numbers of the factors."""
    offset = cursor.position
    size = cursor.integer("<u1", "the size of a number")
    if size not in SCALARS:
        raise cursor.error(f"holds numbers of {size} bytes", offset, "2, 4 or 8 bytes")
    return SCALARS[size]


def _factors(cursor: Cursor, header: Header, components: int, dtype: np.dtype) -> Factors:
    """The place of one factorization, whose shape must fit the header; its numbers are skipped.

    Rows of U tell whether the matrix is transposed, as in the library of the format's authors.
    """
    offset = cursor.position
    shape = (
        cursor.integer("<u4", "the number of rows"),
        cursor.integer("<u4", "the number of columns"),
    )
    pairs_first, texels_first = header.factor_shapes
    if shape not in (pairs_first, texels_first):
        raise cursor.error(
            f"has factors for {shape[0]} rows and {shape[1]} columns",
            offset,
            f"{pairs_first[0]} and {pairs_first[1]}, or {texels_first[0]} and {texels_first[1]}, "
            f"as the {len(header.view)} views, {len(header.light)} lights and {header.width} x "
            f"{header.height} texels demand",
        )
    matrices = []
    for count, what in ((1, "the singular values"), (shape[0], "U"), (shape[1], "SV")):
        matrix = Matrix(cursor.position, count, components, dtype)
        cursor.skip(matrix.nbytes, what)
        matrices.append(matrix)
    singular_values, first, second = matrices
    left, right = (first, second) if shape == pairs_first else (second, first)
    return Factors(singular_values, left, right)
