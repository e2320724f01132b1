"""The lobes of one texel: their values, and their description in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf import MODEL_NAMES, REGISTRY
from ..errors import ConfigError
from ..lobes.batch import LobeBatch
from ..model.spmm import SPMM
from ..render.environment import LUMINANCE


@dataclass(frozen=True)
class TexelLobes:
    """The n lobes of one texel, brightest first.

    Attributes:
        lobes: rho_j.
        weight: alpha_j `[n, C]`.
    """

    lobes: LobeBatch
    weight: Tensor

    @torch.no_grad()
    def values(self, wi: Tensor, wo: Tensor) -> Tensor:
        """alpha_j rho_j(wi, wo) of lights `[N, 3]` and one view `[3]`: `[n, N, C]`."""
        rho = self.lobes.eval(wi[None].to(self.weight), wo[None, None].to(self.weight))  # [n, N]
        return self.weight[:, None] * rho[..., None]  # Eq. (2)


def texel_index(model: SPMM, x: int, y: int) -> int:
    """The texel in column x and row y, row 0 at the top.

    Raises:
        ConfigError: outside of the texture.
    """
    if not (0 <= x < model.width and 0 <= y < model.height):
        raise ConfigError(
            f"--texel {x},{y} lies outside of the texture; expected x from 0 to {model.width - 1} "
            f"and y from 0 to {model.height - 1}, y = 0 at the top."
        )
    return y * model.width + x


@torch.no_grad()
def texel_lobes(model: SPMM, texel: int) -> TexelLobes:
    """The lobes of a texel by falling luminance of their weights."""
    entries = slice(int(model.offset[texel]), int(model.offset[texel + 1]))
    weight = model.weight[entries].detach().cpu()
    order = torch.argsort(luminance(weight), descending=True, stable=True)
    lobes = model.dictionary.detach().to("cpu")[model.index[entries].cpu()[order]]
    return TexelLobes(lobes, weight[order])


def luminance(rgb: Tensor) -> Tensor:
    """Relative luminance `[...]` of linear RGB `[..., 3]` [ITU-R BT.709]; else the mean."""
    if rgb.shape[-1] != len(LUMINANCE):
        return rgb.mean(-1)
    return rgb @ torch.tensor(LUMINANCE, dtype=rgb.dtype)


def angles_text(direction: Tensor) -> str:
    """Polar angle and azimuth of a unit direction `[3]` in whole degrees: `45°, 120°`."""
    x, y, z = direction.tolist()
    theta = math.degrees(math.acos(max(-1.0, min(1.0, z))))
    phi = math.degrees(math.atan2(y, x)) % 360.0 if theta >= 0.5 else 0.0
    return f"{theta:.0f}°, {phi % 359.9999:.0f}°"


def lobe_text(texel: TexelLobes, number: int) -> str:
    """Model, weight, normal and parameters of one lobe, in words."""
    brdf = REGISTRY[int(texel.lobes.model[number])]
    weight = " ".join(f"{x:.3g}" for x in texel.weight[number].tolist())
    values = zip(brdf.parameters, texel.lobes.kappa[number].tolist(), strict=False)
    kappa = ", ".join(f"{row.name} {value:.3g}" for row, value in values)
    normal = angles_text(texel.lobes.normal[number])
    return f"{brdf.title}   weight {weight}   normal {normal}" + (f"   {kappa}" if kappa else "")


def model_title(name: str) -> str:
    """The title of a BRDF: `Blinn-Phong` of `blinn_phong`."""
    return REGISTRY[MODEL_NAMES.index(name)].title
