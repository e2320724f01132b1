"""The relief: a height map as triangles, repeated so far that no ray passes its edge."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .maps import resize, unit

# Segments of a path that the margin must hold: to the hit, to one bounce and to the light, each
# through the whole depth of the relief at the most grazing angle.
REACH = 3


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """Triangles of a relief in texture widths: x right, y up, mean height z = 0.

    The texture covers [0, 1] x [0, aspect].

    Attributes:
        position: vertices `[N, 3]` float32.
        normal: unit shading normals `[N, 3]` float32; None: those of the triangles.
        uv: texture coordinates `[N, 2]` float32, right and down as in Mitsuba, 0 to 1 over the
            texture and beyond that over its repeats.
        faces: corner indices `[F, 3]` uint32, counter-clockwise from above.
    """

    position: np.ndarray
    normal: np.ndarray | None
    uv: np.ndarray
    faces: np.ndarray


def needed_margin(relief: float, lowest_cosine: float) -> float:
    """The margin of repeats around the texture, in texture widths.

    Args:
        relief: height of white above black, in texture widths.
        lowest_cosine: smallest cosine of a ray with z.
    """
    return REACH * relief * math.sqrt(1.0 - lowest_cosine**2) / lowest_cosine


def build_relief(
    height: np.ndarray, relief: float, margin: float, normal: np.ndarray | None = None
) -> ReliefMesh:
    """The triangles of a periodic height map, with one vertex at each centre of a pixel.

    Args:
        height: heights `[h, w]` in [0, 1].
        relief: height of white (1) above black (0), in texture widths.
        margin: width of the repeats on each side, in texture widths.
        normal: unit shading normals `[h', w', 3]`; None: those of the triangles, which converge
            faster with finer triangles than smoothed ones.
    """
    rows, columns = height.shape
    z = relief * (height - height.mean(dtype=np.float64))  # [h, w]
    around = (
        math.ceil(margin * columns) + 1
    )  # one cell more, as edges are half a cell beyond centres
    column = np.arange(-around, columns + around)
    row = np.arange(-around, rows + around)
    x, y = np.meshgrid((column + 0.5) / columns, (rows - row - 0.5) / columns)
    repeated = np.ix_(row % rows, column % columns)
    position = np.stack((x, y, z[repeated]), axis=-1)
    if normal is not None:
        normal = unit(resize(normal, rows, columns))[repeated].reshape(-1, 3)
    uv = np.stack((x, 1.0 - y * (columns / rows)), axis=-1)
    return ReliefMesh(
        position=position.reshape(-1, 3).astype(np.float32),
        normal=normal,
        uv=uv.reshape(-1, 2).astype(np.float32),
        faces=grid_faces(len(row), len(column)),
    )


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles `[F, 3]`, two for each cell of a grid of vertices, row by row from the top."""
    corner = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    top_left, top_right = corner[:-1, :-1], corner[:-1, 1:]
    low_left, low_right = corner[1:, :-1], corner[1:, 1:]
    upper = np.stack((top_left, low_left, top_right), axis=-1)
    lower = np.stack((top_right, low_left, low_right), axis=-1)
    return np.stack((upper, lower), axis=-2).reshape(-1, 3)
