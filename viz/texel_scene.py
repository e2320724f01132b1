"""The scene of one texel: its lobes, and beside them their sum and the measured samples."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..geometry.directions import direction_from_angles, frame_from_normal
from ..lobes.batch import anisotropic_mask
from ..render.display import encode_display
from .measured import Measured
from .palette import LINE, QUIET, SUM, TEXT, series_colour
from .plotter import ROW_HEIGHT
from .polar import mirror_directions, polar_directions, polar_points, polar_triangles
from .scene import Arrow, Dots, Floats, LegendRow, Lines, Part, Scene, Surface, View, Word
from .texel import TexelLobes, angles_text, lobe_text, luminance

# The largest radius of a surface is 1; normals end a little further out.
NORMAL_LENGTH, DOT_RADIUS = 1.18, 0.022
# Distance of each of the two plots from the middle.
HALF_GAP = 1.2
# Size of the window in pixels, with room for ROWS lobes in the legend; more lobes add rows.
WIDTH, HEIGHT, ROWS = 1280, 720, 6
# Half of the height that the camera sees, and its lower edge.
HALF_HEIGHT, LOWEST = 1.42, -0.77
# The camera looks across the plane of wo and z, from this elevation.
ELEVATION = math.radians(24.0)
# Points of a circle.
CIRCLE = 120
# Opacities, so that lobes are seen through each other.
LOBE_OPACITY, SUM_OPACITY = 0.62, 0.8


def texel_scene(
    name: str, texel: TexelLobes, wo: Tensor, measured: Measured | None = None
) -> Scene:
    """Polar plots of a texel's lobes, of their sum and of the measured samples, for one view.

    All radii are luminances in one scale: the largest is 1, and the legend tells its value.

    Args:
        name: of the texel, for the title.
        texel: its lobes.
        wo: unit view direction `[3]`; that of `measured`, if given, takes its place.
        measured: samples under that view.
    """
    wo = (wo if measured is None else measured.wo).double()
    directions = polar_directions(
        torch.cat((mirror_directions(wo, texel.lobes.normal.double()), texel.lobes.normal.double()))
    )
    values = luminance(texel.values(directions.float(), wo.float()))  # [n, N]
    samples = luminance(measured.value) if measured is not None else values.new_zeros(0)
    largest = max((float(x.max()) for x in (values.sum(0), samples) if x.numel()), default=0.0)
    scale = 1.0 / largest if largest > 0.0 else 1.0
    triangles = polar_triangles(directions)
    right = _right(wo)
    left_at, right_at = -HALF_GAP * right, HALF_GAP * right
    parts = [
        *_ground(left_at, right, wo, "lobes"),
        *_ground(right_at, right, wo, "their sum" + " and the samples" * (measured is not None)),
        *_lobes(
            texel, left_at, [polar_points(directions, value, scale) for value in values], triangles
        ),
        Surface(
            right_at + polar_points(directions, values.sum(0), scale), triangles, SUM, SUM_OPACITY
        ),
        *_samples(measured, scale, right_at),
    ]
    height = HEIGHT + ROW_HEIGHT * max(0, len(values) - ROWS)
    return Scene(
        _title(name, wo),
        tuple(parts),
        _legend(texel, largest, measured),
        _view(right, height),
        (WIDTH, height),
    )


def _title(name: str, wo: Tensor) -> str:
    return f"{name} seen from {angles_text(wo)} (polar, azimuth)"


def _right(wo: Tensor) -> Floats:
    """The horizontal direction of wo, which runs rightwards in the picture: `[3]`."""
    flat = wo[:2].numpy()
    length = float(np.linalg.norm(flat))
    unit = flat / length if length > 1e-6 else np.array([1.0, 0.0])
    return np.array([unit[0], unit[1], 0.0])


def _view(right: Floats, height: int) -> View:
    """A camera that sees both plots side by side at its lower edge, `right` to the right."""
    back = np.array([right[1], -right[0], 0.0])
    direction = math.cos(ELEVATION) * back + math.sin(ELEVATION) * np.array([0.0, 0.0, 1.0])
    half = HALF_HEIGHT * height / HEIGHT
    focus = np.array([0.0, 0.0, (LOWEST + half) / math.cos(ELEVATION)])
    return View(focus, direction, np.array([0.0, 0.0, 1.0]), half)


def _ground(at: Floats, right: Floats, wo: Tensor, caption: str) -> list[Part]:
    """Circles on the surface of the texel, the direction of view, and a caption."""
    phi = torch.linspace(0.0, 2.0 * math.pi, CIRCLE, dtype=torch.float64)
    rim = direction_from_angles(torch.full_like(phi, 0.5 * math.pi), phi).numpy()
    circles = np.stack([at + radius * rim for radius in (0.5, 1.0)])
    back = np.array([-right[1], right[0], 0.0])
    cross = np.stack([np.stack((at - v, at + v)) for v in (right, back)])
    up = math.sin(ELEVATION) * back + math.cos(ELEVATION) * np.array([0.0, 0.0, 1.0])
    tip = NORMAL_LENGTH * wo.numpy()
    return [
        Lines(circles, LINE),
        Lines(cross, LINE),
        Arrow(at, tip, TEXT),
        Word("view", at + tip + 0.07 * up + 0.13 * right, 0.075, right, up),
        Word(caption, at - 1.22 * back - 0.06 * up, 0.095, right, up, QUIET),
    ]


def _lobes(
    texel: TexelLobes, at: Floats, plots: list[Floats], triangles: NDArray[np.int64]
) -> list[Part]:
    """The surface of each lobe about `at`, its normal and, if anisotropic, its tangent."""
    turned = anisotropic_mask(texel.lobes.model)
    tangents = _tangents(texel)
    parts: list[Part] = []
    for number, points in enumerate(plots):
        colour = series_colour(number)
        normal = texel.lobes.normal[number].double().numpy()
        parts.append(Surface(at + points, triangles, colour, LOBE_OPACITY))
        parts.append(Arrow(at, NORMAL_LENGTH * normal, colour))
        if bool(turned[number]):
            half = 0.25 * tangents[number]
            tip = at + 0.8 * normal
            parts.append(Lines(np.stack((tip - half, tip + half))[None], colour, 3.0))
    return parts


def _tangents(texel: TexelLobes) -> Floats:
    """The tangent of each lobe `[n, 3]`."""
    return frame_from_normal(texel.lobes.normal, texel.lobes.angle)[:, 0].double().numpy()


def _samples(measured: Measured | None, scale: float, at: Floats) -> list[Part]:
    """A ball for each measured sample, in its measured colour."""
    if measured is None:
        return []
    points = at + polar_points(measured.wi, luminance(measured.value), scale)
    brightest = float(measured.value.max())
    shown = encode_display(measured.value / max(brightest, 1e-9))
    return [Dots(points, DOT_RADIUS, shown.double().numpy())]


def _legend(texel: TexelLobes, largest: float, measured: Measured | None) -> tuple[LegendRow, ...]:
    """A row on the meaning of the radii, and one for each lobe."""
    rows = [
        LegendRow(lobe_text(texel, number), series_colour(number))
        for number in range(len(texel.lobes))
    ]
    radius = f"radius: luminance of the cosine-weighted value; the longest is {largest:.3g}"
    dots = f"balls: {len(measured.wi)} measured lights" if measured is not None else ""
    return (LegendRow("; ".join(filter(None, (radius, dots)))), *rows)
