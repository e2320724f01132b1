"""The bank: fixed candidate lobes that every search starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from ...brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY
from ...geometry.directions import hemisphere_spiral
from ...lobes.batch import Feasible, LobeBatch, encode
from ...lobes.grid import DirectionGrid

Shapes = Mapping[str, Sequence[tuple[float, ...]]]
SHAPES: Shapes = {model.name: model.shapes for model in REGISTRY}
# Shapes of narrow lobes, tried only where values peak.
PEAK_SHAPES: Shapes = {model.name: model.peak_shapes for model in REGISTRY if model.peak_shapes}


@dataclass(frozen=True)
class Bank:
    """A candidate lobes and their values.

    Attributes:
        lobes: the candidates.
        coordinates: their search coordinates, `[A, P]`.
        atoms: values on all pairs, each of unit norm, `[A, D]`.
    """

    lobes: LobeBatch
    coordinates: Tensor
    atoms: Tensor

    @cached_property
    def by_model(self) -> list[tuple[int, Tensor]]:
        """Every model: (index into `MODEL_NAMES`, indices `[N]` of its candidates)."""
        return list(self.lobes.by_model())

    def joined(self, other: Bank) -> Bank:
        """The candidates of both banks."""
        return Bank(
            LobeBatch.cat([self.lobes, other.lobes]),
            torch.cat((self.coordinates, other.coordinates)),
            torch.cat((self.atoms, other.atoms)),
        )


def build_bank(
    grid: DirectionGrid, models: Sequence[str], normal_count: int, feasible: Feasible
) -> Bank:
    """Candidates of all shapes of the models at normals spread evenly over the hemisphere.

    Args:
        grid: the measured pairs.
        models: names of the models.
        normal_count: normals besides the upright one.
        feasible: bounds that the candidates are moved into.
    """
    upright = torch.tensor([[0.0, 0.0, 1.0]])
    normals = torch.cat((upright, hemisphere_spiral(normal_count))).to(grid.light.device)
    return bank_at(grid, {name: SHAPES[name] for name in models}, normals, feasible)


def narrow_bank(
    grid: DirectionGrid, models: Sequence[str], width: float, feasible: Feasible
) -> Bank:
    """Upright candidates of the least width, for peaks that the directions do not resolve."""
    shapes = {}
    for model in (REGISTRY[MODEL_NAMES.index(name)] for name in models):
        wide = [row.from_width for row in model.parameters]
        if any(wide):
            rows = {
                tuple(own if at is None else at(width) for at, own in zip(wide, shape, strict=True))
                for shape in model.shapes
            }
            shapes[model.name] = tuple(sorted(rows))
    upright = torch.tensor([[0.0, 0.0, 1.0]]).to(grid.light.device)
    return bank_at(grid, shapes, upright, feasible)


def bank_at(grid: DirectionGrid, shapes: Shapes, normals: Tensor, feasible: Feasible) -> Bank:
    """Candidates of all `shapes` at each of `normals [N, 3]`, moved into the bounds."""
    batches, upward = [], normals.cpu()
    for name, rows in shapes.items():
        for shape in rows:
            kappa = torch.zeros(len(normals), MAX_PARAMETERS, dtype=normals.dtype)
            kappa[:, : len(shape)] = torch.tensor(shape, dtype=normals.dtype)
            model = torch.full((len(normals),), MODEL_NAMES.index(name))
            batches.append(LobeBatch(model, kappa, upward, kappa.new_zeros(len(normals))))
    lobes = LobeBatch.cat(batches)
    model, start = lobes.model.to(normals.device), encode(lobes).to(normals.device)
    coordinates = feasible.project(model, start)
    lobes = grid.decode(model, coordinates)
    values = grid.eval(lobes)
    norm = values.norm(dim=1)
    visible = norm > 0.0  # False for lobes whose horizon hides every measured pair
    return Bank(lobes[visible], coordinates[visible], values[visible] / norm[visible, None])
