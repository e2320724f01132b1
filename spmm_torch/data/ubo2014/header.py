"""What a UBO2014 file says about itself, and where its factors lie."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

DFMF, FMF06, FMF12 = "DFMF08FC", "FMF06FC", "FMF12FCE"
VARIANTS = (DFMF, FMF06, FMF12)
# Per-view factorizations and unfactored data: known to exist, read by no public loader.
UNSUPPORTED = ("PVF0", "BDIF")
MAGICS = tuple(f"!{name}".encode() for name in (*VARIANTS, *UNSUPPORTED))

SCALARS = {2: np.dtype("<f2"), 4: np.dtype("<f4"), 8: np.dtype("<f8")}
CHANNEL_NAMES = ("R", "G", "B")
CHANNELS = len(CHANNEL_NAMES)
# Length of the three texts of a fixed size.
TEXT_BYTES = 80
# Versions above these have a cosine flag, an XML text and names of the channels.
BEFORE_COSINE, BEFORE_XML, BEFORE_CHANNELS = 1, 2, 3
# Versions of the extension of FMF12FCE from these on tell of log values and of a height map.
WITH_LOG_VALUES, WITH_HEIGHT_MAP = 1, 2


def _no_rotations() -> np.ndarray:
    return np.zeros((0, 3, 3), dtype=np.float32)


def _identity() -> np.ndarray:
    return np.eye(3, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Header:
    """All of a file but its factors.

    Args:
        variant: the magic without "!": DFMF08FC has factors for each channel, FMF06FC and
            FMF12FCE have one pair of factors for all channels.
        width, height: of the pictures.
        view, light: (polar, azimuth) in radians, float32 `[V, 2]` and `[L, 2]`.
        cosine: whether values are already multiplied by the cosine of the light; None if the
            file does not tell.
        colour_model: 0 for RGB, 11 for log Y, U / Y, V / Y (DFMF only).
        log_values: whether values are logarithms, "dynamic range reduction" (FMF12FCE only).
        height_map: codes `[h, w]` uint16, row 0 at the top; the format's authors store float16
            bits in them (FMF12FCE only).
        version: of the header that was read; written is always the newest.
        setup, sensor, light_source: texts of 80 bytes at most.
        pixels_per_mm: resolution of the pictures.
        rgb_scale: as stored; no public loader applies it.
        xml: description of the measurement.
        channel_names: one for each channel.
        rotations: local frames `[n, 3, 3]` float32, as stored; no public loader applies them.
        colour_mean, colour_transform: as stored; colour models 0 and 11 do not use them.
    """

    variant: str
    width: int
    height: int
    view: np.ndarray
    light: np.ndarray
    cosine: bool | None = True
    colour_model: int = 0
    log_values: bool = False
    height_map: np.ndarray | None = None
    version: int = 4
    setup: str = ""
    sensor: str = ""
    light_source: str = ""
    pixels_per_mm: float = 1.0
    rgb_scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    xml: str = ""
    channel_names: tuple[str, ...] = CHANNEL_NAMES
    rotations: np.ndarray = field(default_factory=_no_rotations)
    colour_mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    colour_transform: np.ndarray = field(default_factory=_identity)

    @property
    def texel_count(self) -> int:
        """T, the columns of the factored matrix."""
        return self.width * self.height

    @property
    def pair_count(self) -> int:
        """D, the number of direction pairs."""
        return len(self.view) * len(self.light)

    @property
    def factor_count(self) -> int:
        """How many pairs of factors the variant has."""
        return CHANNELS if self.variant == DFMF else 1

    @property
    def factor_rows(self) -> int:
        """Rows of the factored matrix: direction pairs, times channels where they share it."""
        return self.pair_count * (CHANNELS // self.factor_count)


@dataclass(frozen=True)
class Matrix:
    """Where numbers `[rows, width]` lie in a file, row after row."""

    offset: int
    rows: int
    width: int
    dtype: np.dtype

    @property
    def row_bytes(self) -> int:
        """Distance from one row to the next."""
        return self.width * self.dtype.itemsize

    @property
    def nbytes(self) -> int:
        """Size of all rows."""
        return self.rows * self.row_bytes


@dataclass(frozen=True)
class Factors:
    """Where one factorization U SV^T lies.

    Args:
        singular_values: one row `[1, k]`; they are multiplied into SV already.
        left: U `[rows, k]`, a row for each direction pair (and channel, channel fastest).
        right: SV `[T, k]`, a row for each texel, pictures from the bottom row up.
    """

    singular_values: Matrix
    left: Matrix
    right: Matrix


@dataclass(frozen=True)
class Layout:
    """A checked file: its header, and its factors for each channel or for all of them."""

    header: Header
    factors: tuple[Factors, ...]

    @property
    def scalar_bytes(self) -> int:
        """Size of one number of the factors: 2, 4 or 8."""
        return self.factors[0].right.dtype.itemsize
