"""Light below the lowest measured one: nothing is known but that values end at the horizon."""

from __future__ import annotations

from torch import Tensor

# Least cosine of the lowest measured light, which cosines are divided by: it may be 0.
LOWEST_COSINE = 1e-6


def lowest_cosine(light: Tensor) -> float:
    """z of the lowest of measured lights `[L, 3]`, at least LOWEST_COSINE."""
    return max(float(light[:, 2].min()), LOWEST_COSINE)


def grazing_fade(cosine: Tensor, lowest: float) -> Tensor:
    """min(1, cosine / lowest) `[...]`, by which values below the lowest measured light fade.

    Args:
        cosine: z of lights, `[...]`; those under the horizon fade to 0.
        lowest: z of the lowest measured light; see `lowest_cosine`.
    """
    return (cosine / lowest).clamp(0.0, 1.0)
