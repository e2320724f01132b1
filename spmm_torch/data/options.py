"""What a caller may say about how a BTF is to be read; each reader heeds what concerns it."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from ..config.fit import DataConfig
from ..errors import ConfigError

# Exponent of display-encoded pictures.
DISPLAY_GAMMA = 2.2
# Singular values that a `.btf` keeps of each pair of factors.
DEFAULT_COMPONENTS = 100
# Decoding of small pictures is bound by the interpreter lock: more threads gain nothing.
MAX_THREADS = 8
COSINES = ("auto", "included", "missing")
NEGATIVES = ("refuse", "clip", "keep")
MISSING = ("refuse", "mask")


@dataclass(frozen=True)
class ReadOptions:
    """Options of all readers.

    Args:
        gamma: exponent that makes 8-bit codes linear; 1.0 if they are linear already.
        threads: how many pictures are decoded at once; 0 = one for each core, 8 at most.
        cosine: of the light: "included" in the values, or "missing" and to be multiplied; "auto":
            as a `.btf` says of itself, included in all others.
        negative: of values below zero, such as noise after dark-frame subtraction: "refuse" them,
            "clip" them to zero, which makes dark texels brighter on average, or "keep" them. A
            `.btf` has none: its format clips.
        missing: pairs of directions without a picture: "refuse" them, or "mask" them.

    Raises:
        ConfigError: a value out of its range.
    """

    gamma: float = DISPLAY_GAMMA
    threads: int = 0
    cosine: str = "auto"
    negative: str = "refuse"
    missing: str = "refuse"

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
        ):
            value = getattr(self, name)
            if value not in choices:
                raise ConfigError(f"{name} is {value!r}; expected one of {', '.join(choices)}.")

    @classmethod
    def of(cls, settings: DataConfig) -> ReadOptions:
        """The options that the settings of a fit name."""
        return cls(
            gamma=settings.gamma,
            cosine=settings.cosine,
            negative=settings.negative,
            missing=settings.missing,
        )

    @property
    def thread_count(self) -> int:
        """Number of threads to start."""
        return self.threads or min(os.cpu_count() or 1, MAX_THREADS)


DEFAULT_OPTIONS = ReadOptions()
