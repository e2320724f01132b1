"""The container of RGL `.bsdf` files: arrays by name, as Mitsuba's `TensorFile` reads them.

Little-endian: the magic, a version of two bytes, the number of arrays (u32); for each array the
length of its name (u16), the name, its number of axes (u16), a code of its type (u8), where its
values start (u64), and the length of each axis (u64).
"""

from __future__ import annotations

import math
import struct

import numpy as np

from ...errors import DataError

MAGIC = b"tensor_file\0"
VERSION = (1, 0)
# Types in the order of their codes, from 1.
TYPES = ("<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
MAX_AXES = 8  # of an array; more are damage, not data


def read_tensors(payload: bytes, where: str) -> dict[str, np.ndarray]:
    """The arrays of a file by name; read-only.

    Raises:
        DataError: it is no such file, or it is damaged.
    """
    try:
        return _tensors(payload)
    except (struct.error, ValueError, IndexError) as error:
        raise DataError(
            f"{where} cannot be read ({error}); expected a tensor file of the RGL database, "
            f"version 1.0; copy it again."
        ) from error


def _tensors(payload: bytes) -> dict[str, np.ndarray]:
    if not payload.startswith(MAGIC):
        raise ValueError("it does not start with 'tensor_file'")
    place = len(MAGIC)
    major, minor, count = struct.unpack_from("<BBI", payload, place)
    if (major, minor) != VERSION:
        raise ValueError(f"it has version {major}.{minor}")
    place += struct.calcsize("<BBI")
    tensors = {}
    for _ in range(count):
        name, array, place = _tensor(payload, place)
        tensors[name] = array
    return tensors


def _tensor(payload: bytes, place: int) -> tuple[str, np.ndarray, int]:
    """Name and values of the array described at `place`, and where the next description is."""
    (length,) = struct.unpack_from("<H", payload, place)
    place += 2
    name = payload[place : place + length].decode("utf-8", "strict")
    axes, code, start = struct.unpack_from("<HBQ", payload, place + length)
    place += length + struct.calcsize("<HBQ")
    if not 1 <= code <= len(TYPES) or axes > MAX_AXES:
        raise ValueError(f"array {name!r} has type {code} and {axes} axes")
    shape = struct.unpack_from(f"<{axes}Q", payload, place)
    dtype = np.dtype(TYPES[code - 1])
    count = math.prod(shape)
    if start + count * dtype.itemsize > len(payload):
        raise ValueError(f"array {name!r} ends after the end of the file")
    array = np.frombuffer(payload, dtype, count, start).reshape(shape)
    return name, array, place + 8 * axes
