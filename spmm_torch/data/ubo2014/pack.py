"""The bytes of a UBO2014 file before its factors."""

from __future__ import annotations

import struct

from ...errors import ConfigError
from .header import BEFORE_CHANNELS, CHANNELS, TEXT_BYTES, WITH_HEIGHT_MAP, Header
from .order import BOTTOM, TOP, with_mark

HEADER_VERSION = BEFORE_CHANNELS + 1


def header_bytes(header: Header) -> bytes:
    """The bytes of a header up to the part that depends on the variant.

    The letter R is always written, also without rotations, because the library of the format's
    authors knows two of the variants only with it.

    Raises:
        ConfigError: a text is too long.
    """
    texts = [_fixed_text(header, key) for key in ("setup", "sensor", "light_source")]
    description = b"".join(
        (
            struct.pack("<I", HEADER_VERSION),
            *texts,
            struct.pack("<4f", header.pixels_per_mm, *header.rgb_scale),
            struct.pack("<I", header.cosine is not False),
            _counted(with_mark(header.xml, header.rows or TOP)),
            struct.pack("<I", CHANNELS),
            *map(_counted, header.channel_names),
        )
    )
    light = struct.pack("<I", len(header.light)) + header.light.astype("<f4").tobytes()
    return b"".join(
        (
            f"!{header.variant}R".encode(),
            struct.pack("<I", len(description) + 4),  # includes these four bytes
            description,
            struct.pack("<I", len(header.view)),
            *(view.tobytes() + light for view in header.view.astype("<f4")),
            struct.pack("<2I", header.width, header.height),
            struct.pack("<I", len(header.rotations)),
            header.rotations.astype("<f4").tobytes(),
        )
    )


def _fixed_text(header: Header, key: str) -> bytes:
    """A text of the header, padded with zeros to its fixed size."""
    text = getattr(header, key).encode()
    if len(text) > TEXT_BYTES:
        raise ConfigError(f"{key} has {len(text)} bytes; expected {TEXT_BYTES} at most.")
    return text.ljust(TEXT_BYTES, b"\0")


def _counted(text: str) -> bytes:
    """The length of a text and the text."""
    payload = text.encode()
    return struct.pack("<I", len(payload)) + payload


def colour_bytes(header: Header, components: int) -> bytes:
    """The bytes that only DFMF08FC has; loaders ignore the number of components."""
    numbers = (*header.colour_mean, *header.colour_transform.reshape(-1).tolist())
    return struct.pack("<2I12f", components, header.colour_model, *numbers)


def extension_bytes(header: Header) -> bytes:
    """The bytes that only FMF12FCE has."""
    start = struct.pack("<BI", WITH_HEIGHT_MAP, header.log_values)
    if header.height_map is None:
        return start + struct.pack("<2I", 0, 0)
    height, width = header.height_map.shape
    codes = header.height_map[::-1] if header.rows == BOTTOM else header.height_map
    return start + struct.pack("<2I", width, height) + codes.astype("<u2").tobytes()
