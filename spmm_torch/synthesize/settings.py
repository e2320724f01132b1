"""What a synthesis can be told, checked once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import UBO2003_RINGS, UBO2014_RINGS, ring_directions

# The direction sets of UBO2003 and UBO2014 by their number of directions.
RINGS = {81: UBO2003_RINGS, 151: UBO2014_RINGS}
SCALES = ("auto", "none")
# Deeper relief needs so wide a neighbourhood at grazing angles that its mesh fills the memory.
MAX_RELIEF = 0.5
MAX_SEED = (1 << 63) - 1


@dataclass(frozen=True)
class SynthesisSettings:
    """Settings of `synthesize_btf`.

    Args:
        relief: height difference of white and black in the height map, in texture widths.
        size: texels across the texture; their number down follows from the shape of the maps.
        directions: 81 (those of UBO2003) or 151 (those of UBO2014), for views and lights alike.
        samples: paths of each texel in each picture; those with many divisors stratify well.
        bounces: surface interactions of a path; 1 is direct light alone.
        specular: reflectivity of what is no metal, 0.08 * specular at normal incidence.
        scale: "auto" or "none", see the package.
        gamma: display gamma of 8-bit pictures.
        seed: of every random choice: the same seed, settings and variant give the same bytes.
        variant: of Mitsuba; "auto" is llvm_ad_rgb, or scalar_rgb where that does not work.
        threads: 0 = one for each core.

    Raises:
        ConfigError: a value out of its range.
    """

    relief: float = 0.05
    size: int = 64
    directions: int = 81
    samples: int = 24
    bounces: int = 5
    specular: float = 0.5
    scale: str = "auto"
    gamma: float = 2.2
    seed: int = 0
    variant: str = "auto"
    threads: int = 0

    def __post_init__(self) -> None:
        self._check("relief", 0.0 <= self.relief <= MAX_RELIEF, f"0 to {MAX_RELIEF} texture widths")
        self._check("size", self.size >= 1, "1 texel or more")
        known = " or ".join(map(str, RINGS))
        self._check("directions", self.directions in RINGS, f"{known} as in UBO2003, UBO2014")
        self._check("samples", self.samples >= 1, "1 or more")
        self._check("bounces", self.bounces >= 1, "1 (direct light) or more")
        self._check("specular", 0.0 <= self.specular <= 1.0, "0 to 1; 0.5 is common")
        self._check("scale", self.scale in SCALES, " or ".join(SCALES))
        self._check("gamma", math.isfinite(self.gamma) and self.gamma > 0.0, "a positive number")
        self._check("seed", 0 <= self.seed <= MAX_SEED, "an integer that is not negative")
        self._check("threads", self.threads >= 0, "0 (one for each core) or more")

    def _check(self, name: str, valid: bool, expected: str) -> None:
        if not valid:
            raise ConfigError(
                f"--{name} of spmm synthesize is {getattr(self, name)}; expected {expected}."
            )

    def direction_set(self) -> Tensor:
        """The directions `[N, 3]` of views and lights."""
        return ring_directions(RINGS[self.directions])
