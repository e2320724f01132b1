"""The OpenPBR surface as MaterialX evaluates it: diffuse under GGX, a coat and a fuzz."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from .angles import Angles
from .gltf import axis
from .microfacet import (
    LEAST_ALPHA,
    Roughness,
    dielectric_fresnel,
    ggx_albedo,
    ggx_distribution,
    isotropic,
    smith,
    zeltner,
    zeltner_albedo,
)
from .parameters import NORMAL, Parameter, Values

DIELECTRIC = 0.04  # reflectance at normal incidence of an index of 1.5
MAX_WEIGHT = 0.95 / DIELECTRIC  # specular weight of a reflectance short of a mirror's
MAX_F0 = 0.99999  # as MaterialX clamps it
COAT_IOR = 1.5


class OpenPBRSurface:
    """Lambertian under a tinted dielectric; layers are those of the standard."""

    core = (
        Parameter("base_color", 3, 0.3, power=2.0),
        Parameter("specular_weight", 1, 0.7, 0.0, MAX_WEIGHT, 3.0),
        Parameter("specular_color", 3, 0.9, power=2.0),
        Parameter("specular_roughness", 1, 0.6, 0.08, 1.0),
        NORMAL,
    )
    layers: Mapping[str, tuple[Parameter, ...]] = {
        "anisotropy": (Parameter("anisotropy", 2, 0.3, -0.9, 0.9),),
        "fuzz": (
            Parameter("fuzz_weight", 1, 0.1),
            Parameter("fuzz_color", 3, 0.3, power=2.0),
            Parameter("fuzz_roughness", 1, 0.5, 0.1, 1.0),
        ),
        "coat": (
            Parameter("coat_weight", 1, 0.1),
            Parameter("coat_roughness", 1, 0.3, 0.08, 1.0),
        ),
    }

    def eval(self, values: Values, wi: Tensor, wo: Tensor) -> Tensor:
        """Cosine-weighted RGB `[T, S, 3]`; see `Surface.eval`."""
        angles = Angles.build(values["normal"], wi, wo)
        total = self._base(values, angles)
        if "coat_weight" in values:
            weight, f0 = values["coat_weight"], torch.full_like(values["coat_weight"], DIELECTRIC)
            coat, kept = _dielectric(angles, isotropic(values["coat_roughness"].square()), f0)
            total = (coat * weight)[..., None] + total * (1.0 - weight * (1.0 - kept))[..., None]
        if "fuzz_weight" in values:
            weight, roughness = values["fuzz_weight"], values["fuzz_roughness"]
            fuzz = (weight * zeltner(angles, roughness))[..., None] * values["fuzz_color"][:, None]
            kept = 1.0 - weight * zeltner_albedo(angles.o.cosine.clamp(max=1.0), roughness)
            total = fuzz + total * kept[..., None]
        return total * angles.lit[..., None]

    def _base(self, values: Values, angles: Angles) -> Tensor:
        """Diffuse under the dielectric, cosine-weighted, `[T, S, 3]`."""
        f0 = (values["specular_weight"] * _uncoated(values)).clamp(max=MAX_F0)
        specular, kept = _dielectric(angles, self._alpha(values), f0)
        diffuse = kept * angles.i.z.clamp(min=0.0) / math.pi
        tint, color = values["specular_color"][:, None], values["base_color"][:, None]
        return specular[..., None] * tint + diffuse[..., None] * color

    def _alpha(self, values: Values) -> Roughness:
        """Roughness `[T, 1]` of the base, which a coat makes rougher."""
        roughness = values["specular_roughness"]
        if "coat_weight" in values:
            under = (2.0 * values["coat_roughness"] ** 4 + roughness**4).clamp(max=1.0) ** 0.25
            roughness = torch.lerp(roughness, under, values["coat_weight"])
        alpha = roughness.square()
        if "anisotropy" not in values:
            return isotropic(alpha)
        strength, cos2, sin2 = axis(values["anisotropy"])
        along = alpha * (2.0 / (1.0 + (1.0 - strength).square())).sqrt()
        across = (1.0 - strength) * along
        low = LEAST_ALPHA
        return Roughness(along.clamp(low, 1.0), across.clamp(low, 1.0), cos2, sin2)


def _uncoated(values: Values) -> Tensor:
    """Reflectance at normal incidence of the base `[T, 1]`, whose index a coat comes near to."""
    if "coat_weight" not in values:
        return torch.full_like(values["specular_weight"], DIELECTRIC)
    ior = torch.lerp(
        torch.full_like(values["coat_weight"], COAT_IOR),
        torch.ones_like(values["coat_weight"]),
        values["coat_weight"],
    )
    return ((ior - 1.0) / (ior + 1.0)).square()


def _dielectric(angles: Angles, alpha: Roughness, f0: Tensor) -> tuple[Tensor, Tensor]:
    """Reflection of a dielectric, cosine-weighted, and the share that it lets through, `[T, S]`."""
    mean, view = alpha.mean, angles.o.cosine.clamp(max=1.0)
    fresnel = dielectric_fresnel(angles.cos_d, f0)
    single = ggx_albedo(view, mean, 1.0)
    compensation = 1.0 + fresnel * (1.0 - single) / single
    # Masking as MaterialX has it: of the mean roughness, also where axes differ.
    shape = ggx_distribution(angles, alpha) * smith(angles, Roughness(mean, mean))
    kept = 1.0 - ggx_albedo(view, mean, f0) * compensation
    return shape * fresnel * compensation * angles.i.z.clamp(min=0.0), kept
