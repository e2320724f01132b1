"""Pictures of a material on a shape: eye rays, hits, light, pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..config.render import RenderSettings
from ..errors import ConfigError
from ..runtime.memory import slices
from .camera import Camera
from .direct import BLOCK_DIRECTIONS, Hits, from_delta_lights, from_environment
from .environment import EnvironmentLight
from .fixed_lights import FixedLights, from_fixed_lights
from .lights import DirectionalLight, PointLight
from .material import Material, has_narrow_highlights, with_sampler
from .points import LightNumbers, pixel_points
from .shapes import Shape

Light = DirectionalLight | PointLight | EnvironmentLight
# How environments light a picture: by fixed directions, or by random ones.
Lighting = FixedLights | LightNumbers
# Eye rays that are traced at once.
BLOCK_EYE_RAYS = 1 << 20
# Hits are visited tile by tile of the texture, so that neighbours share what they read.
TILES = 64
DEFAULT_SETTINGS = RenderSettings()


@dataclass(frozen=True)
class Scene:
    """One shape, one camera, and lights.

    Raises:
        ConfigError: there is no light, or the camera or a light lies inside the shape.
    """

    shape: Shape
    camera: Camera
    lights: tuple[Light, ...]

    def __post_init__(self) -> None:
        if not self.lights:
            raise ConfigError("the scene has no light; expected at least one; add one.")
        self._check_outside("camera", self.camera.position, "increase its distance")
        for light in self.lights:
            if isinstance(light, PointLight):
                self._check_outside("light", light.position, "it would light nothing; move it")

    def _check_outside(self, what: str, position: Tensor | None, remedy: str) -> None:
        """Refuses what lies inside the shape; None lies nowhere."""
        if position is not None and self.shape.holds(position):
            place = ", ".join(f"{x:.3g}" for x in position.tolist())
            raise ConfigError(
                f"the {what} at ({place}) lies inside the {type(self.shape).__name__.lower()}; "
                f"expected it outside; {remedy}."
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


def render(
    material: Material,
    scene: Scene,
    settings: RenderSettings = DEFAULT_SETTINGS,
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.float32,
    progress: Callable[[int], object] | None = None,
    differentiable: bool = False,
) -> Rendering:
    """Renders by direct light; the same seed gives the same picture on the same device.

    Args:
        material: an `SPMM`, a `BTFMaterial`, or any other; on `device`.
        scene: shape, camera and lights.
        settings: size and samples.
        device, dtype: of the computation and of the result.
        progress: called with the number of eye rays just done.
        differentiable: whether autograd records the picture, as a function of what the material
            computes with; it then keeps all of it in memory.

    Raises:
        ConfigError: the camera sees nothing of the shape.
    """
    with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
        return _render(material, scene, settings, device, dtype, progress)


def _render(
    material: Material,
    scene: Scene,
    settings: RenderSettings,
    device: torch.device | str,
    dtype: torch.dtype,
    progress: Callable[[int], object] | None,
) -> Rendering:
    """`render`, with or without a record for gradients."""
    count = settings.size**2
    total = torch.zeros(count, 3, dtype=dtype, device=device)
    covered = torch.zeros(count, dtype=dtype, device=device)
    scene = Scene(scene.shape, scene.camera, tuple(_moved(scene.lights, device, dtype)))
    lighting = _lighting(material, scene, settings, total)
    tell = progress or (lambda count: None)
    for pixels in slices(count, max(1, BLOCK_EYE_RAYS // settings.samples)):
        hits = trace(scene, settings, pixels, total)
        for part, light in _by_coverage(hits, lighting, settings.samples):
            for block in hit_blocks(part, scene, _directions(light)):
                total.index_add_(0, block.pixel, shade(material, block, scene.lights, light))
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
    like: Tensor,
    generator: torch.Generator | None = None,
) -> Hits:
    """The hits of all eye rays of consecutive pixels, tile by tile of the texture.

    Args:
        scene: shape and camera.
        settings: size and samples.
        pixels: their numbers.
        like: a tensor `[...]` of the device and dtype of the hits.
        generator: of random points within the pixels, on the CPU; None: fixed ones.
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


def hit_blocks(hits: Hits, scene: Scene, directions: int) -> Iterator[Hits]:
    """The hits in blocks of bounded numbers of directions, `directions` each to environments."""
    each = max(len(scene.lights), directions if _environments(scene.lights) else 1)
    for block in slices(len(hits), max(1, BLOCK_DIRECTIONS // each)):
        yield hits[block]


def shade(material: Material, hits: Hits, lights: Sequence[Light], lighting: Lighting) -> Tensor:
    """Radiance `[N, 3]` from hits to the eye; `lighting` is that of environments."""
    deltas = [light for light in lights if not isinstance(light, EnvironmentLight)]
    total = torch.zeros_like(hits.position)
    if deltas:
        total = total + from_delta_lights(material, hits, deltas)
    if isinstance(lighting, FixedLights):
        return total + from_fixed_lights(material, hits, lighting)
    sampled = with_sampler(material)
    for light in _environments(lights):
        u = lighting.of(hits.pixel, hits.sample)
        total = total + from_environment(sampled, hits, light, (u[0].to(total), u[1].to(total)))
    return total


def _environments(lights: Sequence[Light]) -> list[EnvironmentLight]:
    return [light for light in lights if isinstance(light, EnvironmentLight)]


def _by_coverage(hits: Hits, lighting: Lighting, samples: int) -> Iterator[tuple[Hits, Lighting]]:
    """Hits and their lighting: the eye rays of a pixel share fixed lights out if all of them hit.

    On the edge of the shape, where they do not, each sees all lights.
    """
    if isinstance(lighting, LightNumbers):
        yield hits, lighting
        return
    whole = torch.bincount(hits.pixel)[hits.pixel] == samples
    yield hits[whole], lighting
    edge = hits[~whole]
    yield replace(edge, sample=torch.zeros_like(edge.sample)), lighting.together


def _directions(lighting: Lighting) -> int:
    """Directions of one hit to all environments, or to one and by the material."""
    if isinstance(lighting, FixedLights):
        return lighting.direction.shape[1]
    return 2 * lighting.points.shape[1]


def _lighting(material: Material, scene: Scene, settings: RenderSettings, like: Tensor) -> Lighting:
    """How environments light a picture, on the device of `like [...]`."""
    environments = _environments(scene.lights)
    fixed = settings.lighting == "fixed" or (
        settings.lighting == "auto" and not has_narrow_highlights(material)
    )
    if environments and fixed:
        lights = FixedLights.build(environments, settings.samples, settings.light_samples)
        return lights.to(like)
    generator = torch.Generator().manual_seed(settings.seed)
    shape = settings.size**2, settings.samples, settings.light_samples
    return LightNumbers.draw(*shape, generator).to(like.device)


def _moved(
    lights: Sequence[Light], device: torch.device | str, dtype: torch.dtype
) -> Iterator[Light]:
    """Lights with their maps on the device of the computation."""
    for light in lights:
        yield light.to(device, dtype) if isinstance(light, EnvironmentLight) else light
