"""A fixed bank of candidate lobes, from which every search starts."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, MODEL_NAMES
from ..geometry import hemisphere_spiral
from ..lobe import Feasible, LobeBatch, decode, encode
from .grid import DirectionGrid

EXPONENTS = (4.0, 16.0, 64.0, 256.0)
SLOPES = (0.1, 0.2, 0.4, 0.7)
# Shapes of each model, about a factor of two in width apart: the search bridges that gap.
SHAPES: dict[str, tuple[tuple[float, ...], ...]] = {
    "lambertian": ((),),
    "oren_nayar": ((0.9,),),
    "blinn_phong": tuple((n,) for n in EXPONENTS),
    "ward": tuple((a, a) for a in SLOPES),
    "cook_torrance": tuple(itertools.product(SLOPES, (0.04, 1.0))),
    "lafortune": tuple(itertools.product((-1.4, -1.0, -0.5, 1.0), (3.0, 12.0, 50.0))),
    "ashikhmin_shirley": tuple((n, n, 0.04) for n in EXPONENTS),
    "ward_duer": tuple((a, a) for a in SLOPES),
}


@dataclass(frozen=True)
class Bank:
    """Candidate lobes and their unit-norm values.

    Attributes:
        lobes: A lobes.
        coordinates: their search coordinates, `[A, P]`.
        atoms: values on all pairs, each of unit norm, `[A, D]`.
    """

    lobes: LobeBatch
    coordinates: Tensor
    atoms: Tensor


def build_bank(
    grid: DirectionGrid, models: Sequence[str], normal_count: int, feasible: Feasible
) -> Bank:
    """All shapes of the models at normals spread over the hemisphere, moved inside the bounds."""
    device = grid.light.device
    upright = torch.tensor([[0.0, 0.0, 1.0]])
    normals = torch.cat((upright, hemisphere_spiral(normal_count))).to(device)
    batches = []
    for name in models:
        for shape in SHAPES[name]:
            kappa = torch.zeros(len(normals), MAX_PARAMETERS, device=device)
            kappa[:, : len(shape)] = torch.tensor(shape, device=device)
            model = torch.full((len(normals),), MODEL_NAMES.index(name))
            angle = torch.zeros(len(normals), device=device)
            batches.append(LobeBatch(model, kappa, normals, angle))
    lobes = LobeBatch.cat(batches)
    coordinates = feasible.project(lobes.model, encode(lobes))
    lobes = decode(lobes.model, coordinates)
    values = grid.eval(lobes)
    norm = values.norm(dim=1)
    visible = norm > 0.0  # a lobe may be under the horizon of every measured pair
    return Bank(lobes[visible], coordinates[visible], values[visible] / norm[visible, None])
