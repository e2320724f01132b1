"""BTFs of values that are known: of models, and random ones."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM
from spmm_torch.geometry.directions import ring_directions
from tests.planted.models import measured_values, planted_model

COARSE_RINGS = ((0.0, 1), (20.0, 5), (40.0, 6), (60.0, 8))


def texel_btf(
    values: Tensor,
    light: Tensor,
    view: Tensor | None = None,
    height: int = 1,
    name: str = "planted",
    negative: str = "refuse",
) -> BTF:
    """A BTF of values `[T, D, C]`, one texel high by default; views are the lights by default."""
    view = light if view is None else view
    pictures = values.unflatten(1, (len(view), len(light))).unflatten(0, (height, -1))
    ordered = pictures.permute(2, 3, 0, 1, 4).contiguous()  # [V, L, H, W, C]
    return BTF.from_values(ordered, view, light, name=name, negative=negative)


def random_btf(
    light: Tensor,
    height: int,
    width: int,
    view: Tensor | None = None,
    low: float = 0.0,
) -> BTF:
    """A BTF of values evenly between `low` and 1; views are the lights by default."""
    view = light if view is None else view
    shape = (len(view), len(light), height, width, 3)
    values = torch.rand(shape, generator=torch.Generator().manual_seed(0))
    return BTF.from_values(low + (1.0 - low) * values, view, light)


def picture_btf(values: np.ndarray) -> BTF:
    """A BTF of values `[V, L, H, W, 3]` under some of UBO2003's directions."""
    directions = ring_directions()
    view = directions[torch.arange(values.shape[0]) * 7]
    return BTF.from_values(values, view, directions[-values.shape[1] :])


def texel_major(values: np.ndarray) -> Tensor:
    """Pictures `[V, L, H, W, C]` as values `[T, D, C]`, float32."""
    views, lights, height, width, channels = values.shape
    moved = np.ascontiguousarray(values.transpose(2, 3, 0, 1, 4), dtype=np.float32)
    return torch.from_numpy(moved.reshape(height * width, views * lights, channels))


@torch.no_grad()
def tabulated(model: SPMM) -> BTF:
    """The BTF of a model without residual at its own directions."""
    rho = model.dictionary.eval_grid(model.light, model.view)  # [J, D]
    texel = torch.repeat_interleave(model.lobe_count_per_texel())
    values = torch.zeros(model.texel_count, rho.shape[1], 3)
    values.index_add_(0, texel, model.weight[:, None] * rho[model.index, :, None])
    return texel_btf(values, model.light, model.view, model.height)


def measured(model: SPMM) -> BTF:
    """The BTF of a whole model at its own directions; its residual must not be negative."""
    return texel_btf(measured_values(model), model.light, model.view, model.height, model.name)


def rough_btf(size: int = 6, scale: float = 0.1, seed: int = 3) -> BTF:
    """Texels of planted lobes times noise that no lobe follows; HDR where values exceed 1."""
    btf = tabulated(planted_model(size, rings=COARSE_RINGS, seed=seed))
    values = btf.texels()
    noise = 0.5 + torch.rand(values.shape, generator=torch.Generator().manual_seed(seed))
    return texel_btf(scale * values * noise, btf.light, btf.view, size)
