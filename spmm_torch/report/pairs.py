"""The direction pairs that the page shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.directions import direction_from_angles

Angles = tuple[float, float]
Wanted = Sequence[tuple[str, Angles, Angles]]
# Title, then (polar angle, azimuth) of light and view in degrees; the picture's top is at 90.
WANTED = (
    ("Light and view from above", (0.0, 0.0), (0.0, 0.0)),
    ("Light at 45°, view from above", (45.0, 135.0), (0.0, 0.0)),
    ("Near the mirror direction", (60.0, 90.0), (60.0, 270.0)),
    ("Grazing light", (75.0, 180.0), (30.0, 270.0)),
    ("Grazing view", (45.0, 90.0), (75.0, 0.0)),
)
# Largest distance from a wanted direction, in radians, at which the title is still true.
MAX_DISTANCE = math.radians(25.0)


@dataclass(frozen=True)
class Pair:
    """One direction pair to show, by its indices among lights and views."""

    title: str
    light: int
    view: int


def choose_pairs(
    light: Tensor, view: Tensor, missing: Tensor | None = None, wanted: Wanted = WANTED
) -> tuple[Pair, ...]:
    """The measured pairs nearest to those wanted: from above, oblique, near mirror, grazing.

    Args:
        light: unit vectors `[L, 3]`.
        view: unit vectors `[V, 3]`.
        missing: pairs without a picture, `[V, L]`; None without any.
        wanted: title, and angles of light and view in degrees.

    Returns:
        At least one pair, none twice; wanted pairs that were not measured are left out.
    """
    measured = torch.ones(len(view), len(light), dtype=torch.bool) if missing is None else ~missing
    chosen: dict[tuple[int, int], Pair] = {}
    for title, wanted_light, wanted_view in wanted:
        light_index, light_distance = _nearest(light, *wanted_light)
        view_index, view_distance = _nearest(view, *wanted_view)
        near = max(light_distance, view_distance) <= MAX_DISTANCE
        if near and bool(measured[view_index, light_index]):
            pair = Pair(title, light_index, view_index)
            chosen.setdefault((light_index, view_index), pair)
    first_view, first_light = torch.nonzero(measured)[0].tolist()
    return tuple(chosen.values()) or (Pair("First measured pair", first_light, first_view),)


def angles(direction: Tensor) -> str:
    """Polar angle and azimuth of a unit vector `[3]` in whole degrees: `45° / 140°`."""
    x, y, z = direction.double().tolist()
    theta = math.degrees(math.atan2(math.hypot(x, y), z))
    phi = round(math.degrees(math.atan2(y, x))) % 360 if round(theta) else 0
    return f"{theta:.0f}° / {phi}°"


def directions_text(wi: Tensor, wo: Tensor) -> str:
    """Both directions as text, of unit vectors `[3]`: `light 45° / 140°, view 0° / 0°`."""
    return f"light {angles(wi)}, view {angles(wo)}"


def _nearest(directions: Tensor, theta: float, phi: float) -> tuple[int, float]:
    """(index, distance in radians) of the direction of `[N, 3]` nearest to angles in degrees."""
    degrees = torch.tensor([theta, phi], dtype=torch.float64)
    wanted = direction_from_angles(*torch.deg2rad(degrees))  # [3]
    cosines = directions.double().cpu() @ wanted
    index = int(cosines.argmax())
    return index, math.acos(min(max(float(cosines[index]), -1.0), 1.0))
