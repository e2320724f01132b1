"""Weights of texels and direction pairs by their part in the pictures of one scene.

An eye ray meets one place of the texture. Its radiance is a sum over pairs d of values y_d times
coefficients c_d, the light that arrives through them. Errors e_d of the values change it by at most
(sum_d c_d) sum_d c_d e_d^2, squared (Cauchy-Schwarz), and by about as much where neighbouring pairs
have similar errors. The weight of a pair is therefore c_d sum_d c_d, summed over all eye rays. The
weight of a texel is the sum over its pairs.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...config.render import RenderSettings
from ...data import BTF
from ...data.error_weights import Weights
from ...errors import ConfigError
from ...geometry.directions import texel_at
from ...render.btf_material import BTFMaterial
from ...render.direct import Hits, delta_light_directions, weighted
from ...render.environment import EnvironmentLight
from ...render.points import LightNumbers
from ...render.renderer import Light, Scene, hit_blocks, trace
from ...runtime.memory import slices

# Eye rays traced at once, and width in pixels beyond which weights hardly change.
BLOCK_RAYS = 1 << 18
MAX_SIZE = 256


@torch.no_grad()
def scene_weights(btf: BTF, scene: Scene, settings: RenderSettings, where: str) -> Weights:
    """Weights of the texels and pairs of a BTF, whose values are not read.

    Args:
        btf: material of the shape.
        scene: shape, camera and lights.
        settings: size, samples and seed of the pictures.
        where: name of the scene in messages.

    Raises:
        ConfigError: the camera sees nothing of the shape, or no light reaches what it sees.
    """
    size = min(settings.size, MAX_SIZE)
    settings = replace(settings, size=size)
    material = BTFMaterial.build(btf)
    pair = torch.zeros(btf.pair_count, dtype=torch.float64)
    texel = torch.zeros(btf.texel_count, dtype=torch.float64)
    generator = torch.Generator().manual_seed(settings.seed)
    numbers = LightNumbers.draw(size * size, settings.samples, settings.light_samples, generator)
    seen = 0
    for pixels in slices(size * size, max(1, BLOCK_RAYS // settings.samples)):
        hits = trace(scene, settings, pixels, torch.zeros(0), generator)
        seen += len(hits)
        for block in hit_blocks(hits, scene, 2 * settings.light_samples):
            index, coefficient = _coefficients(material, block, scene.lights, numbers)
            light = coefficient.sum(1, keepdim=True)  # [N, 1]
            pair.index_add_(0, index.flatten(), (coefficient * light).double().flatten())
            corner, bilinear = texel_at(block.uv, btf.height, btf.width)  # [N, 4]
            texel.index_add_(0, corner.flatten(), (bilinear * light * light).double().flatten())
    if not seen or not bool(pair.any()):
        what = (
            "its camera sees nothing of the shape" if not seen else "no light reaches what it sees"
        )
        raise ConfigError(
            f"scene {where} shows nothing: {what}; expected a picture that is not black; turn the "
            f"camera or the lights."
        )
    shape = (len(btf.view), len(btf.light))
    return Weights.build(
        btf, pair.view(shape), texel.view(btf.height, btf.width), where=f"scene {where}"
    )


def _coefficients(
    material: BTFMaterial, hits: Hits, lights: tuple[Light, ...], numbers: LightNumbers
) -> tuple[Tensor, Tensor]:
    """Pairs and their coefficients c_d of N hits, `[N, M]` each."""
    wi, light = _lights(hits, lights, numbers)  # [N, n, 3], [N, n]
    wo = hits.wo[:, None].expand_as(wi)
    index, weight = material.pairs_at(wi, wo, wi.shape[:2])  # [N n, 9]
    weight = weight * light.reshape(-1, 1)
    return index.view(len(hits), -1), weight.view(len(hits), -1)


def _lights(hits: Hits, lights: tuple[Light, ...], numbers: LightNumbers) -> tuple[Tensor, Tensor]:
    """Local light directions `[N, n, 3]` and the light from each, mean of RGB, `[N, n]`."""
    deltas = [light for light in lights if not isinstance(light, EnvironmentLight)]
    parts = [delta_light_directions(hits, deltas)] if deltas else []
    for light in lights:
        if isinstance(light, EnvironmentLight):
            direction, radiance, density = light.sample(numbers.of(hits.pixel, hits.sample)[0])
            each = weighted(radiance, density * direction.shape[1])
            parts.append((hits.local(direction), each))
    wi = torch.cat([part[0] for part in parts], dim=1)
    return wi, torch.cat([part[1] for part in parts], dim=1).mean(-1)
