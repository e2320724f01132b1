"""Settings of `spmm synthesize`; they need no torch, so that help texts are quick."""

from __future__ import annotations

from dataclasses import dataclass

from .schema import check_settings, setting

# Deeper relief needs so wide a neighbourhood at grazing angles that its mesh fills the memory.
MAX_RELIEF = 0.5
MAX_SEED = (1 << 63) - 1
# Variants of Mitsuba: compiled by LLVM, and the plain one that runs everywhere.
FAST, PLAIN = "llvm_ad_rgb", "scalar_rgb"
VARIANTS = ("auto", FAST, PLAIN, "cuda_ad_rgb")


@dataclass(frozen=True)
class SynthesisSettings:
    """Settings of `synthesize_btf`.

    The same seed, settings and variant give the same bytes. A number of samples with many divisors
    stratifies well.

    Raises:
        ConfigError: a value out of its range.
    """

    relief: float = setting(
        0.05,
        "height of white over black in the height map, in texture widths",
        low=0.0,
        high=MAX_RELIEF,
    )
    size: int = setting(64, "texels across; those down follow from the shape of the maps", low=1)
    directions: int = setting(
        81,
        "directions of view, and as many of light: 81 are those of UBO2003, 151 those of UBO2014",
        choices=(81, 151),
    )
    samples: int = setting(24, "paths of each texel in each picture", low=1)
    bounces: int = setting(5, "surfaces that a path of light meets; 1: direct light alone", low=1)
    specular: float = setting(
        0.5, "reflectivity of what is no metal: 0.08 of it at normal incidence", low=0.0, high=1.0
    )
    scale: str = setting(
        "auto",
        "scale of the values: auto divides those of a zip by their 99.8th percentile; none leaves "
        "radiance as it is",
        choices=("auto", "none"),
    )
    gamma: float = setting(2.2, "display gamma of the pictures in a zip", low=0.01, high=10.0)
    seed: int = setting(0, "seed of every random choice", low=0, high=MAX_SEED)
    variant: str = setting(
        "auto",
        f"variant of Mitsuba; auto: {FAST}, or {PLAIN} where that does not work",
        choices=VARIANTS,
    )
    threads: int = setting(0, "threads of Mitsuba; 0: one for each core", low=0)

    def __post_init__(self) -> None:
        check_settings(self)
