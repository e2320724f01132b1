"""Renderings of a BTF, of its model, and of the model's lobes alone, light by light."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..data import BTF
from ..model.spmm import SPMM
from ..render import BTFMaterial, DirectionalLight, Material, RenderSettings, Scene, encode_display
from ..render.direct import delta_light_directions, lit_values
from ..render.display import white_exposure
from ..render.renderer import trace
from ..runtime.memory import slices

# Hits that are evaluated at once, if there is room, and at least: some hundred MB, and some.
BLOCK_HITS, LEAST_HITS = 1 << 15, 1 << 10
# Bytes of a hit under three lights, and of a value of a texel with its copy.
HIT_BYTES, VALUE_BYTES = 1 << 13, 8


@dataclass(frozen=True)
class Renderings:
    """Linear pictures under L lights, by the same eye rays.

    Attributes:
        titles: of the lights.
        original, model, lobes: `[L, H, W, 3]`, row 0 at the top, on the CPU; `lobes` is the model
            without its residual.
        exposure: factor on the pictures of a light, `[L]`.
        counts: pixels that count, `[L, H, W]` bool.
    """

    titles: tuple[str, ...]
    original: Tensor
    model: Tensor
    lobes: Tensor
    exposure: Tensor
    counts: Tensor

    def shown(self) -> tuple[Tensor, Tensor]:
        """Display values in 0..1 of original and model, `[L, H, W, 3]`."""
        factor = self.exposure[:, None, None, None]
        return encode_display(self.original * factor), encode_display(self.model * factor)


@torch.no_grad()
def compare(
    model: SPMM,
    btf: BTF,
    scene: Scene,
    settings: RenderSettings,
    titles: tuple[str, ...],
    device: torch.device | str = "cpu",
    room: int | None = None,
) -> Renderings:
    """Renders a BTF, its model and the model's lobes.

    Args:
        model: on any device; it is not moved.
        btf: decoded or not; its texels are those of the model.
        scene: of directional lights.
        settings: size and samples.
        titles: of the lights.
        device: of the renderings.
        room: bytes that may be taken, which change no value; None: as many as pay.
    """
    placed = model if model.weight.device == torch.device(device) else copy.deepcopy(model)
    placed = placed.to(device)
    original = BTFMaterial.build(btf, device, model.rule)
    if room is not None:
        values = min(original.texel_values, max(0, room) // (2 * VALUE_BYTES))
        original = replace(original, texel_values=values)
    materials = (original, placed, lobes_of(placed))
    return compare_materials(materials, scene, settings, titles, device, block_hits(room))


def block_hits(room: int | None) -> int:
    """Hits that are evaluated at once in a number of bytes; None: as many as pay."""
    if room is None:
        return BLOCK_HITS
    return min(BLOCK_HITS, max(LEAST_HITS, room // (2 * HIT_BYTES)))


@torch.no_grad()
def compare_materials(
    materials: tuple[Material, Material, Material],
    scene: Scene,
    settings: RenderSettings,
    titles: tuple[str, ...],
    device: torch.device | str = "cpu",
    at_once: int = BLOCK_HITS,
) -> Renderings:
    """Renders three materials, the first of which is the original.

    Args:
        materials: original, model and lobes, on the device.
        scene: of directional lights.
        settings: size and samples.
        titles: of the lights.
        device: of the renderings.
        at_once: hits that are evaluated at once.
    """
    original, whole, lobes, white = (
        light_pictures(material, scene, settings, device, at_once).cpu()
        for material in (*materials, _white)
    )
    counts = (white > 1.0 - 0.5 / settings.samples).all(-1)
    exposure = [
        white_exposure(picture[lit].numpy()) for picture, lit in zip(original, counts, strict=True)
    ]
    return Renderings(titles, original, whole, lobes, torch.tensor(exposure), counts)


def light_pictures(
    material: Material,
    scene: Scene,
    settings: RenderSettings,
    device: torch.device | str,
    at_once: int = BLOCK_HITS,
) -> Tensor:
    """A picture for each light of a scene, `[L, S, S, 3]`; all lights share a texel's reads."""
    lights = [light for light in scene.lights if isinstance(light, DirectionalLight)]
    size = settings.size
    total = torch.zeros(size * size, len(lights), 3, device=device)
    generator = torch.Generator().manual_seed(settings.seed)
    hits = trace(scene, settings, slice(0, size * size), total, generator)
    for part in slices(len(hits), at_once):
        block = hits[part]
        wi, irradiance = delta_light_directions(block, lights)  # [N, L, 3]
        total.index_add_(0, block.pixel, lit_values(material, block, wi) * irradiance)
    return (total / settings.samples).view(size, size, -1, 3).permute(2, 0, 1, 3)


def lobes_of(model: SPMM) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """The material of a model without its residual: a function of uv, wi, wo to RGB `[..., 3]`."""

    def lobes(uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Cosine-weighted RGB `[..., 3]` of uv `[..., 2]`, wi and wo `[..., 3]`."""
        return model(uv, wi, wo, residual=False)

    return lobes


def _white(uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
    """A material of value 1, which shows the eye rays that meet the lit side."""
    return torch.ones_like(wi)
