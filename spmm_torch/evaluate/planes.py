"""Pictures of a BTF and of its model on a plane seen at an angle, where relief shows as parallax.

Fixed as for `spheres`: parallel rays from 55 degrees off the normal, two eye rays a pixel, and two
directional lights of unit irradiance, one along the normal and one grazing. The plane shows the
texture once; of a large one its middle, `TEXELS_ACROSS` texels wide. Exposure and pixels that count
are as on the sphere; what is beside the plane is left out.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from ..data import BTF
from ..model.spmm import SPMM
from ..render import Camera, Plane, RenderSettings, Scene, Texture
from .renderings import Renderings, compare
from .spheres import directional_light

SETTINGS = RenderSettings(size=256, samples=2)
TEXELS_ACROSS = 64
# The camera looks from the lower edge of the texture; polar angle and azimuth in degrees.
VIEW = (55.0, 270.0)
# Fraction of the pixels of a whole row that must count.
NEARLY = 0.95
# Title of a light, its angle from the normal of the plane, and its azimuth; degrees.
LIGHTS = (("Light from above", 0.0, 0.0), ("Grazing light, right", 75.0, 0.0))


def compare_planes(
    model: SPMM, btf: BTF, device: torch.device | str = "cpu", room: int | None = None
) -> Renderings:
    """Renders a model and its BTF.

    Args:
        model: on any device; it is not moved.
        btf: decoded or not; its texels are those of the model.
        device: of the renderings.
        room: bytes that may be taken, which change no value; None: as many as pay.
    """
    texture = Texture(min(1.0, TEXELS_ACROSS / btf.width), btf.width / btf.height)
    titles = tuple(title for title, *_ in LIGHTS)
    return _cropped(compare(model, btf, plane_scene(texture), SETTINGS, titles, device, room))


def plane_scene(texture: Texture) -> Scene:
    """The plane seen from `VIEW`, under the lights of `LIGHTS`."""
    lights = tuple(directional_light(*degrees) for _, *degrees in LIGHTS)
    camera = Camera.orthographic(*(math.radians(angle) for angle in VIEW))
    return Scene(Plane(texture), camera, lights)


def _cropped(pictures: Renderings) -> Renderings:
    """The rows and columns of which nearly all pixels count, without the ragged rim."""
    counts = pictures.counts.all(0)  # [S, S]
    across = _most(counts.sum(0))
    down = _most(counts.sum(1))
    names = ("original", "model", "lobes", "counts")
    return replace(pictures, **{name: getattr(pictures, name)[:, down, across] for name in names})


def _most(count: Tensor) -> slice:
    """From the first to the last place `[S]` whose count is nearly the largest one."""
    places = torch.nonzero(count >= NEARLY * count.max()).squeeze(-1)
    return slice(int(places[0]), int(places[-1]) + 1)
