"""The texels and direction pairs with the largest squared errors."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..data import BTF
from ..metrics import snr_db
from .sums import SquaredErrors

# Entries of each list.
LISTED = 10


def worst_texels(energy: Tensor, error: Tensor, width: int) -> list[dict[str, Any]]:
    """The texels with the largest of squared errors `[T]`, worst first; energy of all `[T]`."""
    return [
        {"x": texel % width, "y": texel // width, **_part(energy, error, texel)}
        for texel in _largest(error)
    ]


def worst_pairs(errors: SquaredErrors, btf: BTF, fitted: Tensor) -> list[dict[str, Any]]:
    """The pairs of `fitted [D]` with the largest squared errors, worst first."""
    error = errors.with_residual * fitted
    rows = []
    for pair in _largest(error):
        view, light = divmod(pair, len(btf.light))
        directions = {"light": degrees(btf.light[light]), "view": degrees(btf.view[view])}
        rows.append({**directions, **_part(errors.energy, error, pair)})
    return rows


def _largest(error: Tensor) -> list[int]:
    """Indices of the largest errors above 0."""
    order = error.argsort(descending=True, stable=True)[:LISTED]
    return [index for index in order.tolist() if error[index] > 0.0]


def _part(energy: Tensor, error: Tensor, index: int) -> dict[str, float | None]:
    """SNR of one entry, None where the original is black, and its fraction of the error."""
    of_value, of_error = float(energy[index]), float(error[index])
    snr = snr_db(of_value, of_error) if of_value > 0.0 else None
    return {"snr_db": snr, "error_share": of_error / float(error.sum())}


def degrees(direction: Tensor) -> dict[str, float]:
    """Polar angle and azimuth of a direction `[3]`, in degrees."""
    x, y, z = direction.double().cpu().unbind()
    polar = torch.rad2deg(torch.atan2(torch.hypot(x, y), z))
    azimuth = torch.rad2deg(torch.atan2(y, x)) % 360.0
    return {"polar": round(float(polar), 1), "azimuth": round(float(azimuth), 1) % 360.0}
