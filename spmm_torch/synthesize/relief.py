"""The relief: a height map as triangles, repeated far enough that no ray sees its end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .maps import resize, unit

# A ray may run to its hit, on to one bounce and from there to the light, each time through the
# whole depth at the steepest angle, before it could leave the mesh.
REACH = 3


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """Triangles of a relief in texture widths: x right, y up, mean height z = 0.

    The texture itself covers [0, 1] x [0, aspect].

    Attributes:
        position: `[N, 3]` float32.
        normal: unit shading normals `[N, 3]` float32; None = those of the triangles.
        uv: `[N, 2]` float32, right and down as Mitsuba's pictures run: 0 to 1 over the texture,
            beyond that its repeats.
        faces: corner indices `[F, 3]` uint32, counter-clockwise from above.
    """

    position: np.ndarray
    normal: np.ndarray | None
    uv: np.ndarray
    faces: np.ndarray


def needed_margin(relief: float, lowest_cosine: float) -> float:
    """Texture widths that must surround the texture for rays down to a cosine with z."""
    return REACH * relief * math.sqrt(1.0 - lowest_cosine**2) / lowest_cosine


def build_relief(
    height: np.ndarray, relief: float, margin: float, normal: np.ndarray | None = None
) -> ReliefMesh:
    """Triangulates a periodic height map with one vertex at each of its pixel centres.

    Args:
        height: `[h, w]` in [0, 1].
        relief: height difference of 1 and 0, in texture widths.
        margin: texture widths of its repeats on each side.
        normal: unit shading normals `[h', w', 3]`; None = those of the triangles, which is what
            such a surface has, and converges faster than smoothed ones with finer triangles.
    """
    rows, columns = height.shape
    z = relief * (height - height.mean(dtype=np.float64))  # [h, w]
    around = math.ceil(margin * columns) + 1  # one cell: borders lie half a cell beyond centres
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
    """Two triangles `[F, 3]` for each cell of a grid of vertices, row by row from the top."""
    corner = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    top_left, top_right = corner[:-1, :-1], corner[:-1, 1:]
    low_left, low_right = corner[1:, :-1], corner[1:, 1:]
    upper = np.stack((top_left, low_left, top_right), axis=-1)
    lower = np.stack((top_right, low_left, low_right), axis=-1)
    return np.stack((upper, lower), axis=-2).reshape(-1, 3)
