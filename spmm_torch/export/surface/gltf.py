"""The metallic-roughness surface of glTF 2.0 with its extensions, as appendix B evaluates it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from .angles import TINY, Angles
from .microfacet import (
    Roughness,
    charlie,
    charlie_albedo,
    ggx_distribution,
    isotropic,
    schlick,
    smith,
)
from .parameters import NORMAL, Parameter, Values

DIELECTRIC = 0.04  # reflectance at normal incidence where no extension says otherwise
MAX_TINT = 1.0 / DIELECTRIC  # specular colour of a reflectance of 1


class GLTFSurface:
    """Lambertian and GGX, mixed by metallic; layers are named as extensions are."""

    core = (
        Parameter("base_color", 3, 0.3, power=2.0),
        Parameter("metallic", 1, 0.02),
        Parameter("roughness", 1, 0.6, 0.08, 1.0),
        NORMAL,
    )
    layers: Mapping[str, tuple[Parameter, ...]] = {
        "specular": (
            Parameter("specular", 1, 0.7),
            Parameter("specular_color", 3, 1.0, 0.0, MAX_TINT, 3.0),
        ),
        "anisotropy": (Parameter("anisotropy", 2, 0.3, -1.0, 1.0),),
        "sheen": (
            Parameter("sheen_color", 3, 0.05, power=2.0),
            Parameter("sheen_roughness", 1, 0.5, 0.2, 1.0),
        ),
        "clearcoat": (
            Parameter("clearcoat", 1, 0.1),
            Parameter("clearcoat_roughness", 1, 0.3, 0.08, 1.0),
        ),
    }

    def eval(self, values: Values, wi: Tensor, wo: Tensor) -> Tensor:
        """Cosine-weighted RGB `[T, S, 3]`; see `Surface.eval`."""
        angles = Angles.build(values["normal"], wi, wo)
        # Renderers of glTF stretch highlights along the tangent of the plane, not of the normal.
        stretched = angles.along_plane(wi, wo) if "anisotropy" in values else angles
        total = self._base(values, stretched)
        if "sheen_color" in values:
            total = _with_sheen(values, angles, total)
        if "clearcoat" in values:
            total = _with_clearcoat(values, angles, total)
        return total * (angles.i.z.clamp(min=0.0) * angles.lit)[..., None]

    def _base(self, values: Values, angles: Angles) -> Tensor:
        """Dielectric and metal, mixed, without a cosine, `[T, S, 3]`."""
        color, metallic = values["base_color"][:, None], values["metallic"][:, None]
        alpha = self._alpha(values)
        specular = (ggx_distribution(angles, alpha) * smith(angles, alpha))[..., None]
        grazing = schlick(angles.cos_d)[..., None]
        f0, f90 = _dielectric(values)
        dielectric = f0 + (f90 - f0) * grazing
        diffuse = (1.0 - dielectric.amax(-1, keepdim=True)) * color / math.pi
        metal = color + (1.0 - color) * grazing
        return (1.0 - metallic) * (diffuse + dielectric * specular) + metallic * metal * specular

    def _alpha(self, values: Values) -> Roughness:
        """Roughness `[T, 1]`, along its axes where there is an anisotropy."""
        alpha = values["roughness"].square()
        if "anisotropy" not in values:
            return isotropic(alpha)
        strength, cos2, sin2 = axis(values["anisotropy"])
        along = alpha + (1.0 - alpha) * strength.square()
        return Roughness(along, alpha, cos2, sin2)


def axis(vector: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(strength, cosine and sine of twice the angle), `[T, 1]` each, of an axis.

    Args:
        vector: at twice the angle and as long as strong, `[T, 2]`, since an axis is the same after
            half a turn; or as textures have it, x and y of the axis and its strength, `[T, 3]`.
    """
    if vector.shape[-1] == 3:
        x, y, strength = vector.split(1, dim=-1)
        squared = (x * x + y * y).clamp(min=TINY)
        return strength, (x * x - y * y) / squared, 2.0 * x * y / squared
    length = (vector.square().sum(-1, keepdim=True) + TINY).sqrt()
    cos2, sin2 = (vector / length).split(1, dim=-1)
    return length.clamp(max=1.0), cos2, sin2


def _dielectric(values: Values) -> tuple[Tensor, Tensor]:
    """Reflectances at normal and grazing incidence, `[T, 1, 3]` and `[T, 1, 1]`."""
    if "specular" not in values:
        one = torch.ones_like(values["metallic"])[:, None]
        return (DIELECTRIC * one).expand(-1, -1, 3), one
    weight, tint = values["specular"][:, None], values["specular_color"][:, None]
    return (DIELECTRIC * tint).clamp(max=1.0) * weight, weight


def _with_sheen(values: Values, angles: Angles, base: Tensor) -> Tensor:
    """A sheen over a base `[T, S, 3]`, which keeps what the sheen does not reflect."""
    color, alpha = values["sheen_color"][:, None], values["sheen_roughness"].square()
    albedo = torch.maximum(
        charlie_albedo(angles.i.cosine, alpha), charlie_albedo(angles.o.cosine, alpha)
    )
    kept = 1.0 - color.amax(-1, keepdim=True) * albedo[..., None]
    return color * charlie(angles, alpha)[..., None] + base * kept


def _with_clearcoat(values: Values, angles: Angles, base: Tensor) -> Tensor:
    """A clear coat over a base `[T, S, 3]`."""
    alpha = isotropic(values["clearcoat_roughness"].square())
    fresnel = DIELECTRIC + (1.0 - DIELECTRIC) * schlick(angles.o.cosine)
    share = (values["clearcoat"] * fresnel)[..., None]
    coat = (ggx_distribution(angles, alpha) * smith(angles, alpha))[..., None]
    return base * (1.0 - share) + coat * share
