"""Lobes that are known exactly: given ones, and random ones of given BRDFs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spmm_torch.brdf import MAX_PARAMETERS, MODEL_NAMES
from spmm_torch.config.fit import FitConfig
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.lobes.batch import COORDINATES, LobeBatch, decode

# Planted lobes end at their horizon as those of a fit with default settings do.
HORIZON = math.radians(FitConfig().dictionary.horizon)


@dataclass(frozen=True)
class Lobe:
    """One lobe: BRDF, parameters, tilt of its normal and turn of its tangent in degrees."""

    model: str
    kappa: tuple[float, ...] = ()
    tilt: float = 0.0
    azimuth: float = 0.0
    turn: float = 0.0


def lobe_batch(*lobes: Lobe, dtype: torch.dtype = torch.float32) -> LobeBatch:
    """The lobes in their order."""
    kappa = torch.zeros(len(lobes), MAX_PARAMETERS, dtype=dtype)
    for row, lobe in zip(kappa, lobes, strict=True):
        row[: len(lobe.kappa)] = torch.tensor(lobe.kappa, dtype=dtype)
    angles = [(lobe.tilt, lobe.azimuth, lobe.turn) for lobe in lobes]
    tilt, azimuth, turn = torch.deg2rad(torch.tensor(angles, dtype=torch.float64)).unbind(-1)
    normal = direction_from_angles(tilt, azimuth).to(dtype)
    model = model_index([lobe.model for lobe in lobes])
    return LobeBatch(model, kappa, normal, turn.to(dtype), HORIZON)


def random_lobes(
    names: Sequence[str],
    generator: torch.Generator,
    tilt: float = 0.5,
    low: float = 0.25,
    high: float = 0.75,
    dtype: torch.dtype = torch.float32,
) -> LobeBatch:
    """One lobe for each name.

    Args:
        tilt: width of the square, about the centre of the disk of normals, that normals come from.
        low, high: part of the scale of each other coordinate that values come from.
    """
    coordinates = torch.rand(len(names), COORDINATES, generator=generator, dtype=dtype)
    coordinates[:, :2] = tilt * (coordinates[:, :2] - 0.5)
    coordinates[:, 2:] = low + (high - low) * coordinates[:, 2:]
    return decode(model_index(names), coordinates, HORIZON)


def model_index(names: Sequence[str]) -> Tensor:
    """The index `[J]` of BRDFs in the registry."""
    return torch.tensor([MODEL_NAMES.index(name) for name in names])
