"""The header of a UBO2014 file, and the places of its factors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .colour import RGB, Encoding
from .order import BOTTOM, TOP

DFMF, FMF06, FMF12 = "DFMF08FC", "FMF06FC", "FMF12FCE"
VARIANTS = (DFMF, FMF06, FMF12)
# Per-view factorizations and unfactored data, which no public loader reads.
UNSUPPORTED = ("PVF0", "BDIF")
MAGICS = tuple(f"!{name}".encode() for name in (*VARIANTS, *UNSUPPORTED))

SCALARS = {2: np.dtype("<f2"), 4: np.dtype("<f4"), 8: np.dtype("<f8")}
CHANNEL_NAMES = ("R", "G", "B")
CHANNELS = len(CHANNEL_NAMES)
# Bytes of each of the three texts of fixed size.
TEXT_BYTES = 80
# Versions of the header above these have a cosine flag, an XML text and names of channels.
BEFORE_COSINE, BEFORE_XML, BEFORE_CHANNELS = 1, 2, 3
# Versions of the extension of FMF12FCE from these on have a flag of log values and a height map.
WITH_LOG_VALUES, WITH_HEIGHT_MAP = 1, 2


def _no_rotations() -> np.ndarray:
    return np.zeros((0, 3, 3), dtype=np.float32)


def _identity() -> np.ndarray:
    return np.eye(3, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Header:
    """The content of a file without its factors.

    Args:
        variant: magic without "!": DFMF08FC has factors for each channel, FMF06FC and FMF12FCE
            have one pair of factors for all channels.
        width, height: size of the pictures.
        view, light: angles (polar, azimuth) in radians, float32 `[V, 2]` and `[L, 2]`.
        cosine: whether values contain the cosine of the light; None if the file does not tell.
        colour_model: one of `colour.MODELS`, such as 0 for RGB, 11 for log Y, U / Y, V / Y
            (DFMF08FC only; 0 in the others).
        log_values: whether values are logarithms, "dynamic range reduction" (FMF12FCE only).
        height_map: codes `[h, w]` uint16, row 0 at the top, into which the format's authors store
            the bits of float16 (FMF12FCE only).
        version: version of the header that was read; the newest is always written.
        setup, sensor, light_source: texts of at most 80 bytes.
        pixels_per_mm: resolution of the pictures.
        rgb_scale: factors of the channels as stored; no public loader applies them.
        xml: description of the measurement.
        rows: row of the pictures that comes first in the file, "top" or "bottom", as a file of this
            package states behind its XML; None if the file does not tell.
        channel_names: name of each channel.
        rotations: local frames `[n, 3, 3]` float32 as stored; no public loader applies them.
        colour_mean, colour_transform: `[3]` and `[3, 3]` as stored; only colour model 3 (PCA) uses
            them.
    """

    variant: str
    width: int
    height: int
    view: np.ndarray
    light: np.ndarray
    cosine: bool | None = True
    colour_model: int = RGB
    log_values: bool = False
    height_map: np.ndarray | None = None
    version: int = 4
    setup: str = ""
    sensor: str = ""
    light_source: str = ""
    pixels_per_mm: float = 1.0
    rgb_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    xml: str = ""
    rows: str | None = None
    channel_names: tuple[str, ...] = CHANNEL_NAMES
    rotations: np.ndarray = field(default_factory=_no_rotations)
    colour_mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    colour_transform: np.ndarray = field(default_factory=_identity)

    @property
    def encoding(self) -> Encoding:
        """What the channels of the factors stand for."""
        transform = tuple(map(tuple, self.colour_transform.tolist()))
        return Encoding(self.colour_model, self.log_values, transform, self.colour_mean)

    @property
    def texel_count(self) -> int:
        """The number of texels, T: the columns of the factored matrix."""
        return self.width * self.height

    @property
    def pair_count(self) -> int:
        """The number of direction pairs, D."""
        return len(self.view) * len(self.light)

    @property
    def factor_count(self) -> int:
        """The number of pairs of factors of the variant."""
        return CHANNELS if self.variant == DFMF else 1

    @property
    def factor_rows(self) -> int:
        """The rows of the factored matrix: D, or D C for one matrix of all channels."""
        return self.pair_count * self.joint_channels

    @property
    def joint_channels(self) -> int:
        """The channels of one factored matrix: 1, or C for one matrix of all channels."""
        return CHANNELS // self.factor_count

    @property
    def factor_shapes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns of a factored matrix: of pairs by texels, and of its transpose."""
        joint = self.joint_channels
        return (self.pair_count * joint, self.texel_count), (
            self.texel_count * joint,
            self.pair_count,
        )


@dataclass(frozen=True)
class Matrix:
    """The place of a matrix `[rows, width]` in a file, row by row, from an offset in bytes."""

    offset: int
    rows: int
    width: int
    dtype: np.dtype

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return self.width * self.dtype.itemsize

    @property
    def nbytes(self) -> int:
        """Bytes of all rows."""
        return self.rows * self.row_bytes


@dataclass(frozen=True)
class Factors:
    """The place of one factorization in a file, of a matrix of pairs by texels or its transpose.

    Args:
        singular_values: one row `[1, k]`; the second matrix in the file contains them already.
        left: matrix `[D, k]` or `[D C, k]`, a row for each direction pair (and channel, channel
            fastest): U, or SV of a transposed matrix.
        right: matrix `[T, k]` or `[T C, k]`, a row for each texel (and channel, channel fastest),
            with rows of pictures in the order of the file: SV, or U of a transposed matrix.
    """

    singular_values: Matrix
    left: Matrix
    right: Matrix


@dataclass(frozen=True)
class Layout:
    """The header of a checked file, and the places of its factors, one for each or all channels.

    Args:
        header: header of the file.
        factors: places of the factors.
        rows: row of the pictures that is taken to come first, "top" or "bottom".
    """

    header: Header
    factors: tuple[Factors, ...]
    rows: str = TOP

    @property
    def scalar_bytes(self) -> int:
        """Bytes of one number of the factors: 2, 4 or 8."""
        return self.factors[0].right.dtype.itemsize

    def left_rows(self, pairs: np.ndarray) -> list[RowsOf]:
        """The rows of direction pairs `[n]`, of each channel or of one for all channels."""
        matrices = [part.left for part in self.factors]
        return _of_channels(matrices, pairs, self.header.pair_count)

    def right_rows(self, texels: np.ndarray) -> list[RowsOf]:
        """The rows of texels `[n]`, t = row * W + column, of each channel or of one for all."""
        if self.rows == BOTTOM:
            row, column = np.divmod(texels, self.header.width)
            texels = (self.header.height - 1 - row) * self.header.width + column
        matrices = [part.right for part in self.factors]
        return _of_channels(matrices, texels, self.header.texel_count)


RowsOf = tuple[Matrix, np.ndarray]  # a matrix and indices of some of its rows


def _of_channels(matrices: list[Matrix], rows: np.ndarray, count: int) -> list[RowsOf]:
    """The rows of each channel, of matrices with a row for each of `count` things.

    A matrix of C times as many rows holds all channels, channel fastest.
    """
    if matrices[0].rows != CHANNELS * count:
        return [(matrix, rows) for matrix in matrices]
    return [(matrices[0], rows * CHANNELS + channel) for channel in range(CHANNELS)]
