"""Pictures of a material on a shape: eye rays, hits, light, pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..config.render import RenderSettings
from ..errors import ConfigError
from ..runtime.memory import slices
from .camera import Camera
from .direct import BLOCK_DIRECTIONS, Hits, from_delta_lights, from_environment
from .environment import EnvironmentLight
from .lights import DirectionalLight, PointLight
from .material import Material, with_sampler
from .points import LightNumbers, pixel_points
from .shapes import Shape

Light = DirectionalLight | PointLight | EnvironmentLight
# Eye rays that are traced at once.
BLOCK_EYE_RAYS = 1 << 20
# Hits are visited tile by tile of the texture, so that neighbours share what they read.
TILES = 64
DEFAULT_SETTINGS = RenderSettings()


@dataclass(frozen=True)
class Scene:
    """One shape, one camera, and lights.

    Raises:
        ConfigError: there is no light, or the camera lies inside the shape.
    """

    shape: Shape
    camera: Camera
    lights: tuple[Light, ...]

    def __post_init__(self) -> None:
        if not self.lights:
            raise ConfigError("the scene has no light; expected at least one; add one.")
        position = self.camera.position
        if position is not None and self.shape.holds(position):
            place = ", ".join(f"{x:.3g}" for x in position.tolist())
            raise ConfigError(
                f"the camera at ({place}) lies inside the {type(self.shape).__name__.lower()}; "
                f"expected it outside; increase its distance."
            )


@dataclass(frozen=True)
class Rendering:
    """A rendered picture.

    Attributes:
        picture: linear radiance `[size, size, 3]`, row 0 at the top; black beside the shape.
        coverage: the fraction of each pixel that the shape covers, `[size, size]`.
    """

    picture: Tensor
    coverage: Tensor


@torch.no_grad()
def render(
    material: Material,
    scene: Scene,
    settings: RenderSettings = DEFAULT_SETTINGS,
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.float32,
    progress: Callable[[int], object] | None = None,
) -> Rendering:
    """Renders by direct light; the same seed gives the same picture on the same device.

    Args:
        material: an `SPMM`, a `BTFMaterial`, or any other; on `device`.
        scene: shape, camera and lights.
        settings: size and samples.
        device, dtype: of the computation and of the result.
        progress: called with the number of eye rays just done.

    Raises:
        ConfigError: the camera sees nothing of the shape.
    """
    count = settings.size**2
    total = torch.zeros(count, 3, dtype=dtype, device=device)
    covered = torch.zeros(count, dtype=dtype, device=device)
    scene = Scene(scene.shape, scene.camera, tuple(_moved(scene.lights, device, dtype)))
    generator = torch.Generator().manual_seed(settings.seed)
    numbers = LightNumbers.draw(count, settings.samples, settings.light_samples, generator)
    numbers = numbers.to(device)
    tell = progress or (lambda count: None)
    for pixels in slices(count, max(1, BLOCK_EYE_RAYS // settings.samples)):
        hits = trace(scene, settings, pixels, generator, total)
        for block in hit_blocks(hits, scene, settings):
            total.index_add_(0, block.pixel, shade(material, block, scene.lights, numbers))
            tell(len(block))
        covered.index_add_(0, hits.pixel, torch.ones_like(hits.uv[:, 0]))
        tell((pixels.stop - pixels.start) * settings.samples - len(hits))
    if not bool(covered.any()):
        raise ConfigError(
            f"the camera sees nothing of the {type(scene.shape).__name__.lower()}; expected it in "
            f"front of it, and theta below 90 degrees for a plane."
        )
    square = (settings.size, settings.size)
    picture = (total / settings.samples).view(*square, 3)
    return Rendering(picture, (covered / settings.samples).view(square))


def trace(
    scene: Scene,
    settings: RenderSettings,
    pixels: slice,
    generator: torch.Generator,
    like: Tensor,
) -> Hits:
    """The hits of all eye rays of consecutive pixels, tile by tile of the texture.

    Args:
        scene: shape and camera.
        settings: size and samples.
        pixels: their numbers.
        generator: of points within the pixels, on the CPU.
        like: a tensor `[...]` of the device and dtype of the hits.
    """
    pixel = torch.arange(pixels.start, pixels.stop, device=like.device)
    at = pixel_points(pixel, settings.size, settings.samples, generator).to(like)
    rays = scene.camera.rays(at.flatten(0, 1))
    distance = scene.shape.distance(rays)
    met = torch.nonzero(torch.isfinite(distance)).squeeze(-1)
    direction = rays.direction[met]
    position = rays.origin[met] + distance[met, None] * direction
    frame, uv = scene.shape.surface(position)
    wo = -(frame @ direction[..., None]).squeeze(-1)
    sample = met % settings.samples
    hits = Hits(
        position,
        frame,
        uv,
        wo,
        pixel[torch.div(met, settings.samples, rounding_mode="floor")],
        sample,
    )
    column, row = (torch.remainder(uv, 1.0) * TILES).long().unbind(-1)
    return hits[torch.argsort(row * TILES + column, stable=True)]


def hit_blocks(hits: Hits, scene: Scene, settings: RenderSettings) -> Iterator[Hits]:
    """The hits in blocks of bounded numbers of directions."""
    has_environment = any(isinstance(light, EnvironmentLight) for light in scene.lights)
    each = max(len(scene.lights), 2 * settings.light_samples if has_environment else 1)
    for block in slices(len(hits), max(1, BLOCK_DIRECTIONS // each)):
        yield hits[block]


def shade(material: Material, hits: Hits, lights: Sequence[Light], numbers: LightNumbers) -> Tensor:
    """Radiance `[N, 3]` from hits to the eye."""
    deltas = [light for light in lights if not isinstance(light, EnvironmentLight)]
    total = torch.zeros_like(hits.position)
    if deltas:
        total = total + from_delta_lights(material, hits, deltas)
    sampled = with_sampler(material)
    for light in lights:
        if isinstance(light, EnvironmentLight):
            u = numbers.of(hits.pixel, hits.sample)
            total = total + from_environment(sampled, hits, light, (u[0].to(total), u[1].to(total)))
    return total


def _moved(
    lights: Sequence[Light], device: torch.device | str, dtype: torch.dtype
) -> Iterator[Light]:
    """Lights with their maps on the device of the computation."""
    for light in lights:
        yield light.to(device, dtype) if isinstance(light, EnvironmentLight) else light
