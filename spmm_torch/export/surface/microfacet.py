"""Reflections that renderers' layered surfaces are made of; all shapes broadcast with `[T, S]`.

Formulas and fits are those of the shaders of MaterialX (`libraries/pbrlib/genglsl`, Apache
License 2.0), which name their sources, and of appendix B of the glTF 2.0 specification.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .angles import TINY, Angles, Local

# Least alpha of GGX: a mirror has no values between directions.
LEAST_ALPHA = 1e-3
# Terms 1, x, y, xy, x^2, y^2, x^2 y, x y^2, x^2 y^2 of two ratios, numerators first, that give the
# directional albedo of GGX for a reflectance of 1 at normal, and at grazing incidence.
GGX_ALBEDO = (
    (0.1003, 0.9345, 1.0, 1.0),
    (-0.6303, -2.323, -1.765, 0.2281),
    (9.748, 2.229, 8.263, 15.94),
    (-2.038, -3.748, 11.53, -55.83),
    (29.34, 1.424, 28.96, 13.08),
    (-8.245, -0.7684, -7.507, 41.26),
    (-26.44, 1.436, -36.11, 54.9),
    (19.99, 0.2913, 15.86, 300.2),
    (-5.448, 0.6286, 33.37, -285.1),
)
# Terms 1, x, y, xy, x^2, y^2 of the ratio that gives the directional albedo of Charlie's sheen.
SHEEN_ALBEDO = (
    (13.67300, 1.0),
    (-68.78018, 61.57746),
    (799.08825, 442.78211),
    (-905.00061, 2597.49308),
    (60.28956, 121.81241),
    (1086.96473, 3045.55075),
)


@dataclass(frozen=True)
class Roughness:
    """GGX roughness along two axes, `[T, 1]` each.

    Attributes:
        x, y: alpha along the first axis and across it.
        cos2, sin2: of twice the angle of the first axis from the tangent.
    """

    x: Tensor
    y: Tensor
    cos2: Tensor | float = 1.0
    sin2: Tensor | float = 0.0

    def form(self, w: Local, x: Tensor, y: Tensor) -> Tensor:
        """x w_x^2 + y w_y^2 along the axes of roughness, without turning w."""
        if x is y:
            return x * (w.x.square() + w.y.square())
        even = w.x.square() + w.y.square()
        odd = (w.x.square() - w.y.square()) * self.cos2 + 2.0 * w.x * w.y * self.sin2
        return 0.5 * ((x + y) * even + (x - y) * odd)

    @property
    def mean(self) -> Tensor:
        """Alpha of an isotropic surface of about that roughness."""
        return self.x if self.x is self.y else (self.x * self.y).sqrt()


def isotropic(alpha: Tensor) -> Roughness:
    """Roughness of one alpha `[T, 1]`."""
    alpha = alpha.clamp(min=LEAST_ALPHA)
    return Roughness(alpha, alpha)


def ggx_distribution(angles: Angles, alpha: Roughness) -> Tensor:
    """D of Trowbridge and Reitz, in 1/sr."""
    inverse_x = alpha.x.square().reciprocal()
    inverse_y = inverse_x if alpha.x is alpha.y else alpha.y.square().reciprocal()
    spread = alpha.form(angles.h, inverse_x, inverse_y) + angles.h.z.square()
    return 1.0 / (math.pi * alpha.x * alpha.y * spread.square())


def smith(angles: Angles, alpha: Roughness) -> Tensor:
    """G / (4 cos_i cos_o) with correlated heights."""
    x = alpha.x.square()
    y = x if alpha.x is alpha.y else alpha.y.square()
    i, o = angles.i.cosine, angles.o.cosine
    length_i = (alpha.form(angles.i, x, y) + i.square()).sqrt()
    length_o = (alpha.form(angles.o, x, y) + o.square()).sqrt()
    return 0.5 / (i * length_o + o * length_i)


def schlick(cosine: Tensor) -> Tensor:
    """(1 - cosine)^5, the share of the reflectance at grazing incidence."""
    return (1.0 - cosine).square().square() * (1.0 - cosine)


def dielectric_fresnel(cosine: Tensor, f0: Tensor) -> Tensor:
    """The exact unpolarized reflectance of a dielectric of reflectance f0 at normal incidence."""
    root = f0.clamp(min=TINY).sqrt()
    ior = (1.0 + root) / (1.0 - root)
    g = (ior.square() + cosine.square() - 1.0).clamp(min=TINY).sqrt()
    parallel = ((g + cosine) * cosine - 1.0) / ((g - cosine) * cosine + 1.0)
    return 0.5 * ((g - cosine) / (g + cosine)).square() * (1.0 + parallel.square())


def ggx_albedo(cosine: Tensor, alpha: Tensor, f0: Tensor | float) -> Tensor:
    """Directional albedo of GGX with a reflectance of f0, and 1 at grazing incidence."""
    normal, grazing, low, high = _polynomials(cosine, alpha, GGX_ALBEDO)
    return f0 * (normal / low).clamp(0.0, 1.0) + (grazing / high).clamp(0.0, 1.0)


def charlie(angles: Angles, roughness: Tensor) -> Tensor:
    """The sheen of Estevez and Kulla with the visibility of Neubelt and Pettineo, in 1/sr."""
    inverse = roughness.reciprocal()
    sine = (1.0 - angles.h.z.square()).clamp(min=TINY)
    distribution = (2.0 + inverse) * sine.pow(0.5 * inverse) / (2.0 * math.pi)
    i, o = angles.i.cosine, angles.o.cosine
    return distribution / (4.0 * (i + o - i * o))


def charlie_albedo(cosine: Tensor, roughness: Tensor) -> Tensor:
    """The directional albedo of `charlie`."""
    top, bottom = _polynomials(cosine, roughness, SHEEN_ALBEDO)
    return (top / bottom).clamp(0.0, 1.0)


def zeltner(angles: Angles, roughness: Tensor) -> Tensor:
    """The fibres of Zeltner, Burley and Chiang (2022) times the light's cosine and their albedo."""
    y, x = roughness.clamp(0.01, 1.0), angles.o.cosine.clamp(max=1.0)
    a = (2.58126 * x + 0.813703 * y) * y / (1.0 + 0.310327 * x * x + 2.60994 * x * y)
    falloff = (1.0 - x).clamp(min=TINY).sqrt() * (y - 1.0) * y**3
    b = falloff / (0.0000254053 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y)
    # The light in the frame whose x axis is the view's part in the surface.
    length = (angles.o.x.square() + angles.o.y.square()).clamp(min=TINY).sqrt()
    along = (angles.i.x * angles.o.x + angles.i.y * angles.o.y) / length
    across = (angles.i.y * angles.o.x - angles.i.x * angles.o.y) / length
    z = angles.i.cosine
    squared = (a * along + b * z).square() + (a * across).square() + z.square()
    return z / math.pi * (a / squared).square() * zeltner_albedo(x, y)


def zeltner_albedo(cosine: Tensor, roughness: Tensor) -> Tensor:
    """The directional albedo of `zeltner`."""
    x, y = cosine, roughness.clamp(0.01, 1.0)
    s = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    m = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    o = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    return torch.exp(-0.5 * ((x - m) / s).square()) / (s * math.sqrt(2.0 * math.pi)) + o


def _polynomials(x: Tensor, y: Tensor, terms: tuple[tuple[float, ...], ...]) -> list[Tensor]:
    """Polynomials in x and y, one for each number of a term."""
    powers = (1.0, x, y, x * y, x * x, y * y, x * x * y, x * y * y, x * x * y * y)
    columns = zip(*terms, strict=True)
    return [sum(n * p for n, p in zip(column, powers, strict=False)) for column in columns]  # type: ignore[misc]
