"""Pictures of a BTF and of its model on a sphere under fixed lights, for comparison.

Everything is fixed, so that figures of different materials and models compare:

* A unit sphere fills the picture of 192 x 192 pixels up to a narrow margin, seen by parallel rays
  from the front, 4 stratified eye rays a pixel, the same ones for BTF and model.
* The texture is scaled to 128 texels along half a turn, whatever its size: smaller ones repeat,
  larger ones show their middle. A texel is then about 1.5 pixels wide in the middle, and the
  number of texels to read is bounded.
* Three pictures, each under one directional light of unit irradiance: from the camera, from 45
  degrees at the upper left, and grazing, from 75 degrees at the right.
* A pixel counts if all of its eye rays meet the sphere on its lit side: the same pixels for every
  material.
* The exposure of a pair of pictures maps the 99th percentile of the original's pixels that count
  to 1.
* The tone curve is that of sRGB, after clipping to 0..1; values are not rounded to 8 bits.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..geometry.directions import direction_from_angles
from ..model.spmm import SPMM
from ..render import (
    BTFMaterial,
    Camera,
    DirectionalLight,
    Material,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    encode_display,
)
from ..render.direct import delta_light_directions, lit_values
from ..render.display import white_exposure
from ..render.renderer import trace
from ..runtime.memory import slices

SETTINGS = RenderSettings(size=192, samples=4)
TEXELS_IN_HALF_TURN = 128
# Hits that are evaluated at once: some hundred MB, less than the stages of a fit take.
BLOCK_HITS = 1 << 15
# Title of a light, its angle from the camera's axis, and its azimuth in the picture, counter-
# clockwise from the right; degrees.
LIGHTS = (
    ("Light from the camera", 0.0, 0.0),
    ("Light at 45°, upper left", 45.0, 135.0),
    ("Grazing light, right", 75.0, 0.0),
)


@dataclass(frozen=True)
class Spheres:
    """Pairs of linear pictures under L lights.

    Attributes:
        titles: of the lights.
        original, model: `[L, S, S, 3]`, row 0 at the top, on the CPU.
        exposure: factor on both pictures of a pair, `[L]`.
        counts: pixels that count, `[L, S, S]` bool.
    """

    titles: tuple[str, ...]
    original: Tensor
    model: Tensor
    exposure: Tensor
    counts: Tensor

    def shown(self) -> tuple[Tensor, Tensor]:
        """Display values in 0..1 of original and model, `[L, S, S, 3]`."""
        factor = self.exposure[:, None, None, None]
        return encode_display(self.original * factor), encode_display(self.model * factor)


@torch.no_grad()
def compare_spheres(model: SPMM, btf: BTF, device: torch.device | str = "cpu") -> Spheres:
    """Renders a model and its BTF.

    Args:
        model: on any device; it is not moved.
        btf: decoded or not; its texels are those of the model.
        device: of the renderings.
    """
    texture = Texture(TEXELS_IN_HALF_TURN / btf.width, btf.width / btf.height)
    placed = model if model.weight.device == torch.device(device) else copy.deepcopy(model)
    materials = (BTFMaterial.build(btf, device), placed.to(device), _white)
    original, approximation, white = (
        light_pictures(material, texture, device).cpu() for material in materials
    )
    counts = (white > 1.0 - 0.5 / SETTINGS.samples).all(-1)
    exposure = [
        white_exposure(picture[lit].numpy()) for picture, lit in zip(original, counts, strict=True)
    ]
    titles = tuple(title for title, *_ in LIGHTS)
    return Spheres(titles, original, approximation, torch.tensor(exposure), counts)


def light_pictures(material: Material, texture: Texture, device: torch.device | str) -> Tensor:
    """A picture of the sphere for each light, `[L, S, S, 3]`; all lights share a texel's reads."""
    lights = sphere_lights()
    scene = Scene(Sphere(texture), Camera.orthographic(), lights)
    size = SETTINGS.size
    total = torch.zeros(size * size, len(lights), 3, device=device)
    generator = torch.Generator().manual_seed(SETTINGS.seed)
    hits = trace(scene, SETTINGS, slice(0, size * size), total, generator)
    for part in slices(len(hits), BLOCK_HITS):
        block = hits[part]
        wi, irradiance = delta_light_directions(block, lights)  # [N, L, 3]
        total.index_add_(0, block.pixel, lit_values(material, block, wi) * irradiance)
    return (total / SETTINGS.samples).view(size, size, -1, 3).permute(2, 0, 1, 3)


def sphere_lights() -> tuple[DirectionalLight, ...]:
    """The lights of `LIGHTS`."""
    degrees = torch.tensor([angles for _, *angles in LIGHTS], dtype=torch.float64)
    theta, phi = torch.deg2rad(degrees).unbind(-1)
    return tuple(
        DirectionalLight.build(direction)
        for direction in direction_from_angles(theta, phi).tolist()
    )


def _white(uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
    """A material of value 1, which shows the eye rays that meet the lit side."""
    return torch.ones_like(wi)
