"""The scene of the editor's picture: a shape, a camera and a light, traced once.

Each pixel has one hit, in its middle. While an edit is dragged, a hit takes the nearest texel: a
quarter of the entries that bilinear interpolation reads. Coverage smooths the edges of the shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from ...errors import ConfigError
from ...model.spmm import SPMM
from ...render.camera import Camera
from ...render.lights import DirectionalLight
from ...render.shapes import Plane, Sphere, Texture
from ..slice_picture import direction
from .drape import Drape
from .lobe_cache import LobeCache, never
from .residual_cache import ResidualCache

SHAPES = {"sphere": Sphere, "cloth": Drape, "plane": Plane}
# Texels across a shape at first, and most copies of the texture.
SHOWN_TEXELS, MAX_REPEAT = 130, 8
# Half of the width that the camera sees: the shapes with a margin.
HALF_WIDTH = 1.1
# Rays along each side of a pixel that measure its coverage.
COVERAGE = 3


@dataclass(frozen=True)
class Setting:
    """The shape, light and view that the user chose; angles in degrees, theta from +z.

    Raises:
        ConfigError: a value out of its range.
    """

    shape: str = "sphere"
    repeat: float = 1.0
    light: tuple[float, float] = (30.0, 120.0)
    view: tuple[float, float] = (25.0, -70.0)

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ConfigError(f"shape is {self.shape!r}; expected one of {', '.join(SHAPES)}.")
        if not 0.0 < self.repeat < math.inf:
            raise ConfigError(f"repeat is {self.repeat}; expected a positive number.")
        for name in ("light", "view"):
            theta, phi = getattr(self, name)
            if not (0.0 <= theta <= 180.0 and math.isfinite(phi)):
                raise ConfigError(f"{name} is {theta}, {phi}; expected theta from 0 to 180.")


def first_setting(model: SPMM) -> Setting:
    """A sphere, with copies of the texture that make texels about as large as pixels."""
    return Setting(repeat=float(min(max(1, round(SHOWN_TEXELS / model.width)), MAX_REPEAT)))


class Stage:
    """All that stays the same while a model is edited.

    Args:
        model: gives size, measured directions and device.
        setting: shape, light and view.
        size: pixels along each side.
        smooth: whether texels are interpolated bilinearly; the nearest counts otherwise.
    """

    @torch.no_grad()
    def __init__(self, model: SPMM, setting: Setting, size: int, smooth: bool = False) -> None:
        self.size = size
        like = model.weight.detach()
        shape = SHAPES[setting.shape](Texture(setting.repeat, model.width / model.height))
        camera = Camera.orthographic(*_radians(setting.view), HALF_WIDTH)
        rays = camera.rays(pixel_middles(size, like))
        distance = shape.distance(rays)
        met = torch.nonzero(torch.isfinite(distance)).squeeze(-1)
        position = rays.origin[met] + distance[met, None] * rays.direction[met]
        frame, uv = shape.surface(position)
        light = DirectionalLight.build(direction(_radians(setting.light), like).tolist())
        towards = light.direction.to(like)
        wi = frame @ towards  # [N, 3]
        wo = -(frame @ rays.direction[met, :, None]).squeeze(-1)
        lit = torch.nonzero((wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)).squeeze(-1)
        self.pixel = met[lit]  # [P]
        middles = torch.isfinite(distance).view(size, size)
        self.coverage = coverage(shape, camera, middles).to(like)
        self.uv, self.wi, self.wo, self.smooth = uv[lit], wi[lit], wo[lit], smooth
        self._look_up(model)

    def _look_up(self, model: SPMM) -> None:
        """Finds the texels that the hits show: they change with the relief of the model."""
        self._relief = model.relief
        texel, weight = model.texels_seen(self.uv, self.wo)  # [P, 4]
        if not self.smooth:
            weight, nearest = weight.max(dim=1, keepdim=True)
            texel, weight = texel.gather(1, nearest), torch.ones_like(weight)
        self.lobes = LobeCache(texel, weight, self.wi, self.wo)
        self.residual = ResidualCache(texel, weight, self.wi, self.wo)

    def stale(self, model: SPMM) -> int:
        """The number of (hit, lobe) pairs that a picture of `model` has to evaluate."""
        self._follow(model)
        return self.lobes.stale(model)

    @torch.no_grad()
    def picture(self, model: SPMM, stop: Callable[[], bool] = never) -> Tensor:
        """Linear radiance `[size, size, C]` under irradiance 1; black beside the shape.

        Raises:
            Stopped: `stop` returned True.
        """
        self._follow(model)
        value = (self.lobes.values(model, stop) + self.residual.values(model)).clamp(min=0.0)
        flat = value.new_zeros(self.size**2, value.shape[1])
        return flat.index_copy(0, self.pixel, value).view(self.size, self.size, -1)

    def _follow(self, model: SPMM) -> None:
        """Looks the texels up again where the model has another relief than before."""
        if model.relief is not self._relief:
            self._look_up(model)


def pixel_middles(size: int, like: Tensor) -> Tensor:
    """The middles `[size * size, 2]` of pixels, rightwards and up, row 0 at the top."""
    step = (torch.arange(size, dtype=like.dtype, device=like.device) + 0.5) / size
    y, x = torch.meshgrid(1.0 - step, step, indexing="ij")
    return torch.stack((x, y), dim=-1).flatten(0, 1)


def coverage(shape: Sphere | Plane | Drape, camera: Camera, met: Tensor) -> Tensor:
    """The fraction of each pixel that the shape covers, `[size, size]`.

    Args:
        shape, camera: of the picture.
        met: whether the middle of each pixel shows the shape, `[size, size]`; the fraction is 0
            where it does not, and 1 where those of all neighbours do, too.
    """
    size = len(met)
    covered = met.to(camera.axes.dtype)
    whole = -max_pool2d(-covered[None], 3, stride=1, padding=1)[0]
    row, column = torch.nonzero((covered > 0.0) & (whole == 0.0), as_tuple=True)
    inner = pixel_middles(COVERAGE, covered)  # [s, 2]
    corner = torch.stack((column, size - 1 - row), dim=-1)[:, None]
    rays = camera.rays(((corner + inner) / size).flatten(0, 1))
    hit = torch.isfinite(shape.distance(rays)).view(-1, len(inner))
    covered[row, column] = hit.to(covered).mean(1)
    return covered


def _radians(degrees: tuple[float, float]) -> tuple[float, float]:
    return math.radians(degrees[0]), math.radians(degrees[1])
