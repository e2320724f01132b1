"""What the BRDF tests share: parameter corners, grids and directions."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import BRDF, REGISTRY
from tests.planted.directions import random_directions

ALL_MODELS = [pytest.param(model, id=model.name) for model in REGISTRY]
DTYPES = [torch.float32, torch.float64]


def parameters_at(model: BRDF, unit: Tensor) -> Tensor:
    """Parameters `[..., P]` at `unit [..., P]` of the box, each on its own scale."""
    columns = [row.from_unit(unit[..., column]) for column, row in enumerate(model.parameters)]
    return torch.stack(columns, dim=-1) if columns else unit.clone()


def parameter_grid(
    model: BRDF, steps: tuple[float, ...], dtype: torch.dtype = torch.float64
) -> Tensor:
    """All combinations `[Q, P]` of `steps` in [0, 1] for every parameter."""
    points = list(itertools.product(steps, repeat=len(model.parameters)))
    unit = torch.tensor(points, dtype=dtype).reshape(len(points), len(model.parameters))
    return parameters_at(model, unit)


def corners(model: BRDF, dtype: torch.dtype) -> Tensor:
    """The corners of the parameter box and its centre `[Q, P]`."""
    centre = parameter_grid(model, (0.5,), dtype)
    return torch.cat((parameter_grid(model, (0.0, 1.0), dtype), centre))


def upper_directions(count: int, seed: int, min_cos: float = 0.02) -> Tensor:
    """Random unit directions `[count, 3]` whose cosine is at least `min_cos`, float64."""
    return random_directions(count, seed, math.acos(min_cos))


def direction(cos_theta: Tensor, phi: Tensor) -> Tensor:
    """Unit directions `[..., 3]` of angles that broadcast."""
    cos_theta, phi = torch.broadcast_tensors(cos_theta, phi)
    sin_theta = torch.sqrt((1.0 - cos_theta * cos_theta).clamp(min=0.0))
    return torch.stack((sin_theta * torch.cos(phi), sin_theta * torch.sin(phi), cos_theta), dim=-1)


def near_mirror(wo: Tensor, spread: float, seed: int) -> Tensor:
    """Directions `[N, 3]` in the upper hemisphere about the mirror directions of `wo [N, 3]`."""
    generator = torch.Generator().manual_seed(seed)
    tilt = spread * torch.randn(len(wo), 2, generator=generator, dtype=torch.float64)
    h = torch.nn.functional.normalize(torch.nn.functional.pad(tilt, (0, 1), value=1.0), dim=1)
    wi = 2.0 * (h * wo).sum(dim=1, keepdim=True) * h - wo
    wi[:, 2] = wi[:, 2].abs().clamp(min=0.02)
    return torch.nn.functional.normalize(wi, dim=1)


def rotate_about_z(w: Tensor, angle: float) -> Tensor:
    """`w [..., 3]` turned counter-clockwise about z by `angle` radians."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y, z = w.unbind(-1)
    return torch.stack((cosine * x - sine * y, sine * x + cosine * y, z), dim=-1)
