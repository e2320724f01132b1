"""Options of the readers of BTFs; each reader uses those that concern it."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from ..config.fit import DataConfig
from ..errors import ConfigError
from .file_names import compiled

# Exponent that turns the codes of display-encoded pictures into linear values.
DISPLAY_GAMMA = 2.2
# Number of singular values that a `.btf` file keeps of each pair of factors.
DEFAULT_COMPONENTS = 100
# The interpreter's lock limits the decoding of small pictures: more threads gain nothing.
MAX_THREADS = 8
COSINES = ("auto", "included", "missing")
NEGATIVES = ("refuse", "clip", "keep")
MISSING = ("refuse", "mask")
RINGS = (81, 151)
ROWS = ("top", "bottom")
# Options that are settings of a fit by the same names.
SHARED = ("gamma", "cosine", "negative", "missing", "pattern", "rings", "rows")


@dataclass(frozen=True)
class ReadOptions:
    """Options of all readers.

    Args:
        gamma: exponent that turns codes of 8 and 16 bits into linear values; 1.0 if they are
            linear already.
        threads: number of pictures that are decoded at once; 0: one for each core, at most 8.
        cosine: whether values contain the cosine of the light: "included", "missing" (values are
            then multiplied by it), or "auto" (as a `.btf` file states; included for all others).
        negative: treatment of values below zero, such as noise after dark-frame subtraction:
            "refuse" the BTF, "clip" them to zero, which makes dark texels brighter on average, or
            "keep" them. A `.btf` file has none, as its format clips them.
        missing: treatment of direction pairs without a picture: "refuse" the BTF, or "mask" them.
        pattern: where the angles are in names of pictures, such as "L{tl}_{pl}_V{tv}_{pv}"; None:
            behind "tl", "pl", "tv" and "pv".
        rings: number of directions at which tables of BRDFs are read, 81 (those of UBO2003) or 151
            (of UBO2014).
        rows: row of the pictures that comes first in a `.btf` file that does not tell, "top" or
            "bottom"; files written here tell.

    Raises:
        ConfigError: a value is out of its range, or the pattern is malformed.
    """

    gamma: float = DISPLAY_GAMMA
    threads: int = 0
    cosine: str = "auto"
    negative: str = "refuse"
    missing: str = "refuse"
    pattern: str | None = None
    rings: int = 81
    rows: str = "top"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gamma) and self.gamma > 0.0):
            raise ConfigError(
                f"gamma is {self.gamma}; expected a positive number; use {DISPLAY_GAMMA} for "
                f"display-encoded pictures and 1.0 for linear ones."
            )
        if self.threads < 0:
            raise ConfigError(f"threads is {self.threads}; expected 0 (one for each core) or more.")
        for name, choices in (
            ("cosine", COSINES),
            ("negative", NEGATIVES),
            ("missing", MISSING),
            ("rings", RINGS),
            ("rows", ROWS),
        ):
            value = getattr(self, name)
            if value not in choices:
                expected = ", ".join(map(str, choices))
                raise ConfigError(f"{name} is {value!r}; expected one of {expected}.")
        if self.pattern is not None:
            compiled(self.pattern)

    @classmethod
    def of(cls, settings: DataConfig) -> ReadOptions:
        """The options in the settings of a fit."""
        return cls(**{name: getattr(settings, name) for name in SHARED})

    def settings(self) -> DataConfig:
        """The settings of a fit that mean these options."""
        return DataConfig(**{name: getattr(self, name) for name in SHARED})

    @property
    def thread_count(self) -> int:
        """The number of threads to start."""
        return self.threads or min(os.cpu_count() or 1, MAX_THREADS)


DEFAULT_OPTIONS = ReadOptions()
