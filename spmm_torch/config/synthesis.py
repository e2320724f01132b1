"""Settings of `spmm synthesize`; without torch, so that help texts are quick."""

from __future__ import annotations

from dataclasses import dataclass

from .schema import MAX_SEED, check_settings, setting

# A deeper relief needs so many repeats around it at grazing angles that its mesh fills the memory.
MAX_RELIEF = 0.5
# Variants of Mitsuba: one compiled by LLVM, and a slower one that runs everywhere.
FAST, PLAIN = "llvm_ad_rgb", "scalar_rgb"
VARIANTS = ("auto", FAST, PLAIN, "cuda_ad_rgb")


@dataclass(frozen=True)
class SynthesisSettings:
    """Settings of `synthesize_btf`.

    The same seed, settings and variant give the same bytes. Samples are stratified best where their
    number has many divisors.

    Raises:
        ConfigError: a value out of its range.
    """

    relief: float = setting(
        0.05,
        "height of white above black in the height map, in texture widths",
        low=0.0,
        high=MAX_RELIEF,
    )
    size: int = setting(
        64, "texels across; the number of rows follows from the shape of the maps", low=1
    )
    directions: int = setting(
        81,
        "number of views, and of lights: 81 are the directions of UBO2003, 151 those of UBO2014",
        choices=(81, 151),
    )
    samples: int = setting(24, "paths traced for each texel of each picture", low=1)
    bounces: int = setting(
        5, "maximum number of surface hits of a light path; 1: direct light alone", low=1
    )
    specular: float = setting(
        0.5,
        "reflectance of non-metals at normal incidence, as a fraction of 0.08",
        low=0.0,
        high=1.0,
    )
    scale: str = setting(
        "auto",
        "scale of the values: auto divides those of a zip by their 99.8th percentile; none keeps "
        "radiance",
        choices=("auto", "none"),
    )
    gamma: float = setting(2.2, "display gamma of the pictures in a zip", low=0.01, high=10.0)
    seed: int = setting(0, "seed of every random choice", low=0, high=MAX_SEED)
    variant: str = setting(
        "auto",
        f"variant of Mitsuba; auto: {FAST}, or {PLAIN} where {FAST} does not work",
        choices=VARIANTS,
    )
    threads: int = setting(0, "number of threads of Mitsuba; 0: one for each core", low=0)

    def __post_init__(self) -> None:
        check_settings(self)
