"""The pixels of Radiance pictures, in both of their run-length encodings.

The current encoding stores each scanline channel by channel. A byte n of at most 128 precedes n
literal bytes; a byte n above 128 repeats the next byte n - 128 times. The old encoding stores whole
pixels, where (1, 1, 1, n) repeats the pixel before n times. Scanlines without runs are read as old.
Writers may choose anew for each scanline.

Source: `color.c` of Radiance.
"""

from __future__ import annotations

import math

import numpy as np

# Scanlines of the current encoding start with this mark and their width, whose first byte is at
# most MAX_WIDTH_BYTE; in old files a larger byte follows the same mark.
PLANES_MARK = b"\x02\x02"
MAX_WIDTH_BYTE = b"\x7f"
MIN_PLANE_WIDTH, MAX_PLANE_WIDTH = 8, 0x7FFF
MAX_LITERAL = 128  # largest number of literal bytes; a byte above it stands for a run
MAX_RUN = 127
MIN_RUN = 4  # shorter runs take as many bytes as literals
# In the old encoding the pixel (1, 1, 1, n) is a run; a second one right after it counts 256 n.
OLD_RUN_MARK = 1
MAX_OLD_SHIFT = 24
# Most pixels and runs that an old scanline is made of, for each of its pixels: one and the three
# runs of length 0 that may stand before the byte of a run that counts.
MAX_PIECES = 4


def decode_scanlines(data: bytes, height: int, width: int) -> np.ndarray:
    """Codes `[H, W, 4]` uint8 of the scanlines in `data`, in stored order.

    Raises:
        ValueError: the data end early, or a run crosses the end of its scanline.
    """
    if _may_hold_planes(width) and (_is_encoded(data, 0) or _mark(width) in data):
        return _decode_rows(data, height, width)
    return _decode_pixels(data, height, width)[0]


def encode_scanlines(codes: np.ndarray) -> bytes:
    """Scanlines of codes `[H, W, 4]` uint8, with runs where the width allows them.

    Raises:
        ValueError: a code would read as a run.
    """
    width = codes.shape[1]
    if _may_hold_planes(width):
        mark = _mark(width)
        return b"".join(mark + b"".join(map(_encode_plane, row.T)) for row in codes)
    if (codes[..., :3] == OLD_RUN_MARK).all(axis=-1).any():
        raise ValueError(
            f"a picture {width} pixels wide is written without runs, where the code (1, 1, 1, e) "
            f"would be taken for one; normalize the codes"
        )
    return codes.tobytes()


def _may_hold_planes(width: int) -> bool:
    """Whether the current encoding allows a width."""
    return MIN_PLANE_WIDTH <= width <= MAX_PLANE_WIDTH


def _mark(width: int) -> bytes:
    """The four bytes that start a scanline of the current encoding."""
    return PLANES_MARK + width.to_bytes(2, "big")


def _is_encoded(data: bytes, position: int) -> bool:
    """Whether a scanline that starts here looks like one of the current encoding."""
    start = data[position : position + len(PLANES_MARK) + 1]
    return start.startswith(PLANES_MARK) and start[-1:] <= MAX_WIDTH_BYTE


def _decode_rows(data: bytes, height: int, width: int) -> np.ndarray:
    """Codes `[H, W, 4]` of scanlines, each of which has its own encoding."""
    mark = _mark(width)
    if len(data) < height * _fewest_bytes(width):
        raise ValueError(f"it is truncated: {len(data)} bytes cannot hold {width} x {height}")
    pieces: list[bytes] = []
    position, encoded = 0, False
    for row in range(height):
        if data.startswith(mark, position):
            encoded = True
            position = _append_row(pieces, data, position + len(mark), width, row)
        elif _is_encoded(data, position) and (encoded or row == 0):
            raise ValueError(f"scanline {row} does not start with its width")
        else:
            try:
                position = _append_pixels(pieces, data, position, width)
            except ValueError as error:
                if not encoded:  # runs cross the ends of scanlines, and the mark is a pixel
                    break
                raise ValueError(f"scanline {row}: {error}") from None
    if not encoded:
        return _decode_pixels(data, height, width)[0]
    return _interleaved(b"".join(pieces), height, width)


def _fewest_bytes(width: int) -> int:
    """The fewest bytes of a scanline in either encoding."""
    return min(4 + 4 * 2 * math.ceil(width / MAX_RUN), 4 * 2)


def _interleaved(planes: bytes, height: int, width: int) -> np.ndarray:
    """Codes `[H, W, 4]` of scanlines that were stored channel by channel."""
    flat = np.frombuffer(planes, dtype=np.uint8)
    if flat.size != height * width * 4:
        raise ValueError("it is truncated in its last scanline")
    stored = flat.reshape(height, 4, width)
    codes = np.empty((height, width, 4), dtype=np.uint8)
    for channel in range(4):  # faster than one transposed copy
        codes[..., channel] = stored[:, channel]
    return codes


def _append_row(pieces: list[bytes], data: bytes, position: int, width: int, row: int) -> int:
    """Appends the four channels of an encoded scanline; returns the position of the next."""
    try:
        for _ in range(4):
            position = _append_plane(pieces, data, position, width)
    except IndexError:
        raise ValueError(f"it is truncated in scanline {row}") from None
    return position


def _append_pixels(pieces: list[bytes], data: bytes, position: int, width: int) -> int:
    """Appends the channels of one scanline of whole pixels; returns the position of the next."""
    codes, used = _decode_pixels(data[position : position + 4 * MAX_PIECES * width], 1, width)
    pieces.append(codes[0].T.tobytes())
    return position + used


def _append_plane(pieces: list[bytes], data: bytes, position: int, width: int) -> int:
    """Appends the bytes `[W]` of one channel of a scanline; returns the position of the next.

    Raises:
        ValueError: a run is empty or too long.
        IndexError: the data end early.
    """
    left = width
    while left > 0:
        count = data[position]
        position += 1
        if count > MAX_LITERAL:
            count -= MAX_LITERAL
            pieces.append(data[position : position + 1] * count)
            position += 1
        elif count:
            pieces.append(data[position : position + count])
            position += count
        else:
            raise ValueError("it holds a run of no pixels")
        left -= count
    if left:
        raise ValueError("a run crosses the end of its scanline")
    return position


def _decode_pixels(data: bytes, height: int, width: int) -> tuple[np.ndarray, int]:
    """Codes `[H, W, 4]` of whole pixels and runs of them, and the number of bytes they take."""
    whole = len(data) // 4 * 4
    pixels = np.frombuffer(data[:whole], dtype=np.uint8).reshape(-1, 4)  # [N, 4]
    index = np.arange(len(pixels))
    is_run = (pixels[:, :3] == OLD_RUN_MARK).all(axis=1)  # [N]
    source = np.maximum.accumulate(np.where(is_run, -1, index))  # the pixel that is repeated
    shift = 8 * np.maximum(index - source - 1, 0)
    count = np.where(is_run, pixels[:, 3].astype(np.int64) << np.minimum(shift, MAX_OLD_SHIFT), 1)
    filled = np.cumsum(count)
    needed = height * width
    last = int(np.searchsorted(filled, needed))
    if last == len(filled):
        raise ValueError(f"it is truncated: {len(data)} bytes do not fill {width} x {height}")
    if filled[last] != needed or source[0] < 0 or shift[: last + 1].max() > MAX_OLD_SHIFT:
        raise ValueError("a run has no pixel before it, or crosses the end of the picture")
    chosen = np.repeat(source[: last + 1], count[: last + 1])  # [H * W]
    return pixels[chosen].reshape(height, width, 4), 4 * (last + 1)


def _encode_plane(plane: np.ndarray) -> bytes:
    """The bytes `[W]` of one channel of a scanline as runs and literals."""
    starts = np.concatenate(([0], np.flatnonzero(plane[1:] != plane[:-1]) + 1))
    lengths = np.diff(starts, append=len(plane))
    payload = plane.tobytes()
    pieces: list[bytes] = []
    position = 0
    for start, length in zip(
        starts[lengths >= MIN_RUN].tolist(), lengths[lengths >= MIN_RUN].tolist(), strict=True
    ):
        pieces += _literals(payload[position:start])
        pieces += _runs(payload[start : start + 1], length)
        position = start + length
    return b"".join(pieces + _literals(payload[position:]))


def _literals(payload: bytes) -> list[bytes]:
    """Bytes as they are, each part behind its length."""
    parts = [payload[i : i + MAX_LITERAL] for i in range(0, len(payload), MAX_LITERAL)]
    return [bytes((len(part),)) + part for part in parts]


def _runs(value: bytes, length: int) -> list[bytes]:
    """One byte repeated `length` times, as runs."""
    full, rest = divmod(length, MAX_RUN)
    counts = [MAX_RUN] * full + [rest] * (rest > 0)
    return [bytes((MAX_LITERAL + count,)) + value for count in counts]
