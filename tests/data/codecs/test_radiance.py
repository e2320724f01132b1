"""Radiance pictures against a naive reader and a naive writer, both byte by byte."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spmm_torch.data.codecs import radiance
from spmm_torch.data.codecs.radiance import decode, encode, float_to_rgbe, rgbe_to_float

FEW_CODES = st.sampled_from([0, 1, 2, 3, 128, 255])  # so that runs are common
SIZES = st.tuples(st.integers(1, 4), st.integers(1, 300), st.just(4))
PICTURES = arrays(np.uint8, SIZES, elements=FEW_CODES)
NOISE = np.random.default_rng(0).integers(2, 256, (5, 40, 4), dtype=np.uint8)


def header(size: tuple[int, int], *lines: str) -> bytes:
    first = ["#?RADIANCE", "# made by hand", "FORMAT=32-bit_rle_rgbe", *lines]
    return "\n".join([*first, "", f"-Y {size[0]} +X {size[1]}", ""]).encode()


def naive_value(code: np.ndarray) -> list[float]:
    """The value of one code, in the words of the format."""
    red, green, blue, exponent = (int(part) for part in code)
    if exponent == 0:
        return [0.0, 0.0, 0.0]
    return [mantissa / 256.0 * 2.0 ** (exponent - 128) for mantissa in (red, green, blue)]


def naive_decode(payload: bytes) -> np.ndarray:
    """Codes of a well-formed file in today's run-length encoding."""
    text, _, data = payload.partition(b"\n\n")
    assert text.startswith(b"#?RADIANCE\n") and b"FORMAT=32-bit_rle_rgbe" in text
    resolution, _, rest = data.partition(b"\n")
    _, height, _, width = resolution.split()
    codes = np.zeros((int(height), int(width), 4), dtype=np.uint8)
    stream = iter(rest)
    for row in codes:
        assert [next(stream) for _ in range(4)] == [2, 2, *divmod(len(row), 256)]
        for channel in range(4):
            column = 0
            while column < len(row):
                count = next(stream)
                repeated = next(stream) if count > 128 else None
                for _ in range(count - 128 if count > 128 else count):
                    row[column, channel] = next(stream) if repeated is None else repeated
                    column += 1
    assert next(stream, None) is None
    return codes


def naive_encode(codes: np.ndarray, rng: np.random.Generator) -> bytes:
    """Scanlines of codes, cut into runs and literals of random length wherever that is allowed."""
    parts = []
    for row in codes:
        parts.append(bytes([2, 2, *divmod(len(row), 256)]))
        for values in row.T.tolist():
            position = 0
            while position < len(values):
                here = values[position:]
                same = next((i for i, v in enumerate(here) if v != here[0]), len(here))
                if rng.random() < 0.5:
                    count = int(rng.integers(1, min(same, 127) + 1))
                    parts.append(bytes([128 + count, here[0]]))
                else:
                    count = int(rng.integers(1, min(len(here), 128) + 1))
                    parts.append(bytes([count, *here[:count]]))
                position += count
    return b"".join(parts)


def old_encode(codes: np.ndarray) -> bytes:
    """Pixels one after the other; one that repeats is counted by (1, 1, 1, n), low byte first."""
    parts = []
    pixels = codes.reshape(-1, 4).tolist()
    position = 0
    while position < len(pixels):
        same = 1
        while position + same < len(pixels) and pixels[position + same] == pixels[position]:
            same += 1
        parts.append(bytes(pixels[position]))
        repeats = same - 1
        while repeats:
            parts.append(bytes([1, 1, 1, repeats % 256]))
            repeats //= 256
        position += same
    return b"".join(parts)


@given(PICTURES, st.integers(0, 2**31))
def test_reads_every_choice_of_runs(codes: np.ndarray, seed: int) -> None:
    if codes.shape[1] < 8:
        codes = np.tile(codes, (1, 8, 1))
    payload = header(codes.shape[:2]) + naive_encode(codes, np.random.default_rng(seed))
    np.testing.assert_array_equal(decode(payload), codes)


@given(PICTURES)
def test_what_is_written_reads_back(codes: np.ndarray) -> None:
    if codes.shape[1] < 8:
        codes = np.where(codes == 1, np.uint8(7), codes)
    payload = encode(codes)
    found = decode(payload)
    np.testing.assert_array_equal(found, codes)
    assert found.dtype == np.uint8 and found.flags.c_contiguous
    if codes.shape[1] >= 8:
        np.testing.assert_array_equal(naive_decode(payload), codes)


def test_runs_save_space() -> None:
    codes = np.full((16, 1000, 4), 130, dtype=np.uint8)
    assert len(encode(codes)) < 0.02 * codes.size
    assert len(encode(np.tile(NOISE, (4, 4, 1)))) < 1.05 * 16 * NOISE.size


@settings(max_examples=50)
@given(PICTURES, st.integers(1, 80_000))
def test_old_encoding_and_flat(codes: np.ndarray, repeats: int) -> None:
    codes = np.where(codes == 1, np.uint8(7), codes)
    codes[0, 0] = (9, 8, 7, 130)  # else it may look like a scanline of today's encoding
    size = codes.shape[:2]
    np.testing.assert_array_equal(decode(header(size) + codes.tobytes()), codes)
    np.testing.assert_array_equal(decode(header(size) + old_encode(codes)), codes)
    long = np.broadcast_to(np.uint8([9, 8, 7, 130]), (1, repeats, 4))
    np.testing.assert_array_equal(decode(header((1, repeats)) + old_encode(long)), long)
    codes[0, 0] = (2, 2, 200, 130)  # looks like one at first
    np.testing.assert_array_equal(decode(header(size) + codes.tobytes()), codes)


@given(PICTURES, st.data())
def test_each_scanline_may_have_its_own_encoding(codes: np.ndarray, data: st.DataObject) -> None:
    """As Radiance's own reader decides anew for each: flat, old runs, or today's."""
    codes = np.tile(np.where(codes == 1, np.uint8(7), codes), (1, 8, 1))
    codes[:, 0] = (9, 8, 7, 130)  # else a flat scanline may look like one of today's encoding
    rng = np.random.default_rng(0)
    encoders = [lambda row: row.tobytes(), old_encode, lambda row: naive_encode(row, rng)]
    kinds = data.draw(st.lists(st.integers(0, 2), min_size=len(codes), max_size=len(codes)))
    rows = [encoders[kind](row[None]) for kind, row in zip(kinds, codes, strict=True)]
    np.testing.assert_array_equal(decode(header(codes.shape[:2]) + b"".join(rows)), codes)


@pytest.mark.parametrize("flat", [[0], [1], [0, 2, 4], [4]], ids=str)
def test_every_truncation_of_mixed_scanlines_is_told(flat: list[int]) -> None:
    start = header((5, 40))
    rows = [
        row.tobytes() if number in flat else encode(row[None]).partition(b"+X 40\n")[2]
        for number, row in enumerate(NOISE)
    ]
    payload = start + b"".join(rows)
    np.testing.assert_array_equal(decode(payload), NOISE)
    for length in range(len(start), len(payload)):
        with pytest.raises(ValueError, match="truncated|scanline"):
            decode(payload[:length])


@pytest.mark.parametrize("width", [3, 7, 40_000])
def test_widths_without_runs(width: int) -> None:
    codes = np.random.default_rng(1).integers(2, 256, (2, width, 4), dtype=np.uint8)
    payload = encode(codes)
    assert payload.endswith(codes.tobytes())
    np.testing.assert_array_equal(decode(payload), codes)
    codes[1, 2, :3] = 1
    with pytest.raises(ValueError, match="taken for one"):
        encode(codes)


def test_rows_of_atrium_run_upward() -> None:
    usual = encode(NOISE)
    malformed = usual.replace(b"-Y 5 +X 40\n", b"+X 40 -Y 5\n")
    assert malformed != usual
    np.testing.assert_array_equal(decode(malformed), NOISE[::-1])
    assert decode(malformed).flags.c_contiguous


def test_other_orders_of_scanlines() -> None:
    for order, expected in (
        (b"+Y 5 +X 40\n", NOISE[::-1]),
        (b"-Y 5 -X 40\n", NOISE[:, ::-1]),
        (b"+Y 5 -X 40\n", NOISE[::-1, ::-1]),
    ):
        payload = encode(NOISE).replace(b"-Y 5 +X 40\n", order)
        np.testing.assert_array_equal(decode(payload), expected)
    for order in (b"+X 40 +Y 5\n", b"-X 40 -Y 5\n", b"-Y 5 +Y 40\n"):
        with pytest.raises(ValueError, match="scanlines run as"):
            decode(encode(NOISE).replace(b"-Y 5 +X 40\n", order))


@given(arrays(np.uint8, (6, 4), elements=st.integers(0, 255)))
def test_value_of_a_code(codes: np.ndarray) -> None:
    expected = np.array([naive_value(code) for code in codes])
    values = rgbe_to_float(codes)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(rgbe_to_float(float_to_rgbe(values)), values)


@given(arrays(np.float32, (3, 3), elements=st.floats(0.0, 2.0**126, width=32)))
def test_nearest_code(values: np.ndarray) -> None:
    codes = float_to_rgbe(values)
    brightest = values.max(axis=-1, keepdims=True).astype(float)
    # Half a step of a mantissa of which the brightest fills at least half; the floor is 2^-136.
    bound = np.maximum(brightest / 256.0, 2.0**-136)
    assert (np.abs(rgbe_to_float(codes).astype(float) - values) <= bound).all()
    assert ((codes[:, 3] == 0) == (codes[:, :3] == 0).all(axis=-1)).all()


def test_codes_known_by_heart() -> None:
    pairs = [
        ((1.0, 0.5, 0.25), (128, 64, 32, 129)),
        ((0.0, 0.0, 0.0), (0, 0, 0, 0)),
        ((255.0, 1.0, 0.0), (255, 1, 0, 136)),
        ((255.9, 0.0, 0.0), (128, 0, 0, 137)),  # rounds up to the next exponent
        ((65535.0, 1.0, 3.0), (128, 0, 0, 145)),
    ]
    values, codes = (np.array(part) for part in zip(*pairs, strict=True))
    np.testing.assert_array_equal(float_to_rgbe(values), codes)


def test_sixteen_bit_range_keeps_its_maximum() -> None:
    values = np.full((4, 9, 3), 0.001)
    values[1, 2] = 65280.0  # 255 * 2^8
    found = rgbe_to_float(decode(encode(float_to_rgbe(values))))
    assert found.max() == 65280.0
    np.testing.assert_allclose(found[0, 0], 0.001, rtol=1 / 256)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, 3e38])
def test_values_that_no_code_has(value: float) -> None:
    with pytest.raises(ValueError, match="negative|too large"):
        float_to_rgbe(np.array([[0.5, value, 0.5]]))


def test_exposure_is_divided_out() -> None:
    codes = float_to_rgbe(np.random.default_rng(2).uniform(0.1, 4.0, (5, 40, 3)))
    values = rgbe_to_float(codes)
    data = encode(codes).partition(b"+X 40\n")[2]

    def values_with(*lines: str) -> np.ndarray:
        return rgbe_to_float(decode(header((5, 40), *lines) + data))

    np.testing.assert_array_equal(values_with("EXPOSURE=1.0"), values)
    np.testing.assert_array_equal(values_with("EXPOSURE=8", "EXPOSURE= 0.5"), values / 4)
    steps = values.max(axis=-1, keepdims=True) / 256
    factors = np.array([0.3, 0.6, 1.5])
    found = values_with("EXPOSURE=0.3", "COLORCORR=1 2 5")
    assert (np.abs(found * factors - values) <= 5 * steps).all()
    for line in ("EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=1e400", "COLORCORR=1 2"):
        with pytest.raises(ValueError, match="header line|exposure"):
            values_with(line)
    with pytest.raises(ValueError, match="exposure"):
        values_with(*["EXPOSURE=1e200"] * 3)


def test_primaries_are_those_that_are_read() -> None:
    """Rec.709, those of Radiance itself, or none, as Photoshop writes them; others by name."""
    codes = NOISE[..., :4]
    for value in (
        "0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.3290",
        "0.640 0.330 0.290 0.600 0.150 0.060 0.333 0.333",
        "0 0 0 0 0 0 0 0",
    ):
        payload = header(codes.shape[:2], f"PRIMARIES={value}") + codes.tobytes()
        np.testing.assert_array_equal(decode(payload), codes)
    for value in ("0.708 0.292 0.17 0.797 0.131 0.046 0.3127 0.329", "0.64 0.33", "nan " * 8):
        payload = header(codes.shape[:2], f"PRIMARIES={value}") + codes.tobytes()
        with pytest.raises(ValueError, match="PRIMARIES=.* expected those of Rec.709"):
            decode(payload)


def test_headers() -> None:
    assert radiance.accepts(b"#?RADIANCE\nFORM") and radiance.accepts(b"#?RGBE\n")
    assert not radiance.accepts(b"\x89PNG\r\n\x1a\n") and not radiance.accepts(b"")
    payload = encode(NOISE)
    windows = payload.replace(b"RADIANCE\n", b"RGBE\r\n").replace(b"\n\n", b"\r\n\r\n")
    np.testing.assert_array_equal(decode(windows), NOISE)
    for old, new, message in (
        (b"rgbe", b"xyze", "32-bit_rle_xyze"),
        (b"#?", b"##", "does not start"),
        (b"-Y 5", b"-Y five", "resolution line"),
        (b"-Y 5", b"-Y 0", "size is 40 x 0"),
        (b"-Y 5", b"-Y 99999999", "size is 40 x 99999999"),
        (b"-Y 5", b"-Y 999999", "cannot hold 40 x 999999"),
        (b"+X 40", b"+X 41", "does not start with its width"),
        (b"\n\n", b"\n" + b"A=B\n" * 2000 + b"\n", "has no end"),
        (b"\n\n", b"\n" + b"A" * 99999 + b"\n\n", "ends early"),
    ):
        with pytest.raises(ValueError, match=message):
            decode(payload.replace(old, new, 1))


def test_bad_runs() -> None:
    start = header((1, 8)) + bytes([2, 2, 0, 8])
    whole = bytes([8 + 128, 5])
    for planes, message in (
        (bytes([9 + 128, 5]) + whole * 3, "crosses the end of its scanline"),
        (bytes([9]) + bytes(9) + whole * 3, "crosses the end of its scanline"),
        (bytes([0]) + whole * 4, "no pixels"),
        (whole * 3 + bytes([8, 1, 2, 3]), "truncated in its last scanline"),
    ):
        with pytest.raises(ValueError, match=message):
            decode(start + planes)
    for pixels in (
        bytes([1, 1, 1, 3, 9, 9, 9, 130] + [5, 5, 5, 130] * 4),  # nothing to repeat
        bytes([9, 9, 9, 130, 1, 1, 1, 8]),  # one too many
        bytes([9, 9, 9, 130] + [1, 1, 1, 0] * 4 + [1, 1, 1, 1] + [9, 9, 9, 130] * 8),  # n << 32
    ):
        with pytest.raises(ValueError, match="no pixel before it, or crosses"):
            decode(header((1, 8)) + pixels)


@pytest.mark.parametrize("payload", [encode(NOISE), header((5, 40)) + NOISE.tobytes()])
def test_every_truncation_is_told(payload: bytes) -> None:
    np.testing.assert_array_equal(decode(payload), NOISE)
    for length in range(len(payload)):
        with pytest.raises(ValueError):
            decode(payload[:length])


@settings(max_examples=500)
@given(st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4))
def test_changed_bytes_raise_or_read(changes: list[tuple[int, int]]) -> None:
    payload = bytearray(encode(NOISE))
    for position, value in changes:
        payload[position % len(payload)] = value
    try:
        codes = decode(bytes(payload))
    except ValueError:
        return
    assert codes.dtype == np.uint8 and codes.shape[2] == 4


def test_pictures_that_are_no_codes() -> None:
    for picture in (NOISE[..., :3], NOISE[0], NOISE[:0], NOISE.astype(np.float32)):
        with pytest.raises(ValueError, match="codes have"):
            encode(picture)
