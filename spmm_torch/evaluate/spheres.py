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

import torch

from ..data import BTF
from ..geometry.directions import direction_from_angles
from ..model.spmm import SPMM
from ..render import Camera, DirectionalLight, RenderSettings, Scene, Sphere, Texture
from .renderings import Renderings, compare

SETTINGS = RenderSettings(size=192, samples=4)
TEXELS_IN_HALF_TURN = 128
# Title of a light, its angle from the camera's axis, and its azimuth in the picture, counter-
# clockwise from the right; degrees.
LIGHTS = (
    ("Light from the camera", 0.0, 0.0),
    ("Light at 45°, upper left", 45.0, 135.0),
    ("Grazing light, right", 75.0, 0.0),
)


def compare_spheres(
    model: SPMM, btf: BTF, device: torch.device | str = "cpu", room: int | None = None
) -> Renderings:
    """Renders a model and its BTF.

    Args:
        model: on any device; it is not moved.
        btf: decoded or not; its texels are those of the model.
        device: of the renderings.
        room: bytes that may be taken, which change no value; None: as many as pay.
    """
    texture = Texture(TEXELS_IN_HALF_TURN / btf.width, btf.width / btf.height)
    titles = tuple(title for title, *_ in LIGHTS)
    return compare(model, btf, sphere_scene(texture), SETTINGS, titles, device, room)


def sphere_scene(texture: Texture) -> Scene:
    """The sphere seen from the front, under the lights of `LIGHTS`."""
    lights = tuple(directional_light(*degrees) for _, *degrees in LIGHTS)
    return Scene(Sphere(texture), Camera.orthographic(), lights)


def directional_light(theta: float, phi: float) -> DirectionalLight:
    """A light of unit irradiance from (theta, phi) in degrees, theta from +z of the world."""
    angles = torch.deg2rad(torch.tensor([theta, phi], dtype=torch.float64))
    return DirectionalLight.build(direction_from_angles(*angles).tolist())
