"""The scene of many texels: the lobes of each stand where the texel lies, coloured by model."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..errors import ConfigError
from ..lobes.ragged import groups
from ..model.spmm import SPMM
from .palette import model_colour
from .polar import mirror_directions, polar_directions, polar_triangles
from .scene import Floats, LegendRow, Part, Picture, Scene, Surface, View
from .slice_picture import slice_codes
from .texel import angles_text, luminance, model_title, texel_lobes

# Directions of one small surface: evenly spread, and on its rim.
EVEN, RIM = 300, 48
# Most texels along the longer side of the texture.
MAX_TEXELS = 32
# Height of the tallest surface, in distances between neighbouring texels.
TALLEST = 0.95
OPACITY = 0.5
ELEVATION = math.radians(48.0)


def mosaic_scene(model: SPMM, across: int, wo: Tensor) -> Scene:
    """Lobes of evenly spread texels, `across` of them along the longer side of the texture.

    All radii are luminances in one scale; surfaces of the same BRDF have the same colour.

    Args:
        model: of the texture.
        across: texels along the longer side.
        wo: unit view direction `[3]`.

    Raises:
        ConfigError: too few or too many texels.
    """
    if not 1 <= across <= MAX_TEXELS:
        raise ConfigError(f"--mosaic is {across}; expected 1 to {MAX_TEXELS} texels across.")
    chosen = spread_texels(model.height, model.width, across)  # [n]
    wo = wo.double()
    top = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    directions = polar_directions(mirror_directions(wo, top), EVEN, RIM)
    plots = [texel_lobes(model, int(texel)) for texel in chosen]
    values = [luminance(plot.values(directions.float(), wo.float())) for plot in plots]  # [n_j, N]
    largest = max(float(value.amax()) if value.numel() else 0.0 for value in values)
    half = _half_size(model)
    step = 2.0 * max(half) / across
    scale = TALLEST * step / largest if largest > 0.0 else 1.0
    models = torch.cat([plot.lobes.model for plot in plots])  # [E]
    radii = scale * torch.cat(values).double()  # [E, N]
    owner = torch.repeat_interleave(torch.tensor([len(plot.lobes) for plot in plots]))
    at = texel_places(chosen, model.height, model.width, half)[owner.numpy()]  # [E, 3]
    parts = [_ground(model, half), *_surfaces(models, radii, at, directions)]
    title = f"Lobes of {len(chosen)} texels seen from {angles_text(wo)} (polar, azimuth)"
    return Scene(title, tuple(parts), _legend(models, largest), _view())


def spread_texels(height: int, width: int, across: int) -> Tensor:
    """Indices `[n]` of evenly spread texels, `across` of them along the longer side at most."""
    longest = max(height, width)
    rows, columns = (
        _middles(side, max(1, min(side, round(across * side / longest))))
        for side in (height, width)
    )
    return (rows[:, None] * width + columns).flatten()


def _middles(side: int, count: int) -> Tensor:
    """The middles `[count]` of equal parts of a side."""
    return ((torch.arange(count, dtype=torch.float64) + 0.5) * side / count).long()


def texel_places(texel: Tensor, height: int, width: int, half: tuple[float, float]) -> Floats:
    """Where texels `[n]` lie on a rectangle of half width and height: `[n, 3]`, row 0 far off."""
    u = (texel % width + 0.5) / width
    v = 1.0 - (torch.div(texel, width, rounding_mode="floor") + 0.5) / height
    flat = torch.stack(((2.0 * u - 1.0) * half[0], (2.0 * v - 1.0) * half[1]), dim=-1)
    return np.pad(flat.double().numpy(), ((0, 0), (0, 1)))


def _half_size(model: SPMM) -> tuple[float, float]:
    """Half width and half height of the texture, whose longer side is 2."""
    longest = max(model.height, model.width)
    return model.width / longest, model.height / longest


def _ground(model: SPMM, half: tuple[float, float]) -> Picture:
    """The texture from above, pale, so that surfaces stand out."""
    codes = (255 - (255 - slice_codes(model).astype(np.uint16)) * 55 // 100).astype(np.uint8)
    right, up = np.array([half[0], 0.0, 0.0]), np.array([0.0, half[1], 0.0])
    return Picture(codes, np.array([0.0, 0.0, -0.002]), right, up)


def _surfaces(models: Tensor, radii: Tensor, at: Floats, directions: Tensor) -> list[Part]:
    """One surface for each BRDF, made of those of its E_m lobes."""
    triangles = polar_triangles(directions)
    parts: list[Part] = []
    for model, rows in groups(models, len(MODEL_NAMES)):
        points = at[rows.numpy(), None] + (radii[rows, :, None] * directions).numpy()
        faces = _repeated(triangles, len(rows), len(directions))
        parts.append(Surface(points.reshape(-1, 3), faces, model_colour(model), OPACITY))
    return parts


def _repeated(triangles: NDArray[np.int64], count: int, points: int) -> NDArray[np.int64]:
    """The triangles `[F, 3]` of `count` surfaces of as many points each: `[count * F, 3]`."""
    first = np.arange(count)[:, None, None] * points
    return (triangles + first).reshape(-1, 3)


def _legend(models: Tensor, largest: float) -> tuple[LegendRow, ...]:
    rows = [
        LegendRow(model_title(MODEL_NAMES[model]), model_colour(model))
        for model, _ in groups(models, len(MODEL_NAMES))
    ]
    note = f"radius: luminance of the cosine-weighted value of a lobe; the longest is {largest:.3g}"
    return (LegendRow(note), *rows)


def _view() -> View:
    direction = np.array([0.0, -math.cos(ELEVATION), math.sin(ELEVATION)])
    return View(np.array([-0.3, 0.0, 0.12]), direction, np.array([0.0, 0.0, 1.0]), 1.1)
