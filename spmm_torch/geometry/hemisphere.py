"""Values at measured directions, interpolated all over the hemisphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy.spatial import ConvexHull, Delaunay, QhullError
from torch import Tensor

from .directions import disk_from_normal, normal_from_disk

# Six times the volume of the tetrahedron of a triangle and the origin; smaller ones have no usable
# inverse in float32.
MIN_TRIANGLE_VOLUME = 1e-6
# A query that rounding puts this far out of every cell still belongs to the nearest one.
EDGE_TOLERANCE = 1e-4
# Squares along an edge of the map that tells where to look for the cell of a query: far smaller
# than the triangles of measured directions, and made in some hundredths of a second.
MAP_SIZE = 128
# No step on Lambert's equal-area disk moves a direction by more than this times its length.
DISK_STRETCH = 2.0
# Queries that are compared with all cells at once, where the map does not help.
QUERY_BLOCK = 1 << 13


@dataclass(frozen=True)
class HemisphereInterpolation:
    """Piecewise linear, continuous interpolation of values at N measured directions.

    Directions are joined by the spherical Delaunay triangulation (the upper side of their convex
    hull); a query takes the barycentric weights of the plane through its triangle, so measured
    directions return their own value. A query below the lowest ring is lifted along z to the edge
    above it. Where neither is possible (fewer than three directions, directions on one side
    only) the nearest direction counts.

    Attributes:
        directions: `[N, 3]`.
        triangles: corner indices `[F, 3]`; the third corner of a lifting cell is unused.
        inverse: takes a direction to unnormalized barycentric weights: the entries of a 3 x 3
            matrix, row after row, for each cell, `[9, F]`.
        third: 1 where the third corner has a value, 0 where it is -z, `[F]`.
        candidates: cells that reach into each square of a map of the equal-area disk, likely
            ones first, -1 for none, `[most, MAP_SIZE * MAP_SIZE]`.
    """

    directions: Tensor
    triangles: Tensor
    inverse: Tensor
    third: Tensor
    candidates: Tensor

    @classmethod
    def build(cls, directions: Tensor) -> HemisphereInterpolation:
        """Triangulates upper unit `directions [N, 3]`; the same ones only once."""
        host = directions.detach().cpu().contiguous()
        built = _built(host.numpy().tobytes(), host.dtype)
        return built.to(directions.device)

    def to(self, device: torch.device | str) -> HemisphereInterpolation:
        """The same interpolation on another device."""
        parts = (self.directions, self.triangles, self.inverse, self.third, self.candidates)
        return HemisphereInterpolation(*(part.to(device) for part in parts))

    def weights(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """Corners and weights of directions `w [..., 3]`: (index `[..., 3]`, weight `[..., 3]`).

        Weights are not negative and sum to 1.
        """
        flat = w.reshape(-1, 3)
        index, weight = self._weights(flat)
        return index.reshape(w.shape), weight.reshape(w.shape)

    def _weights(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """`weights` of queries `[Q, 3]`."""
        with torch.no_grad():
            cell = self._locate(w)  # [Q]
        held = cell >= 0
        if not bool(held.all()):
            return self._weights_where(held, w, cell)
        parts = self._shares(cell, self._barycentric(cell, w))
        total = parts[0] + parts[1] + parts[2]
        weight = torch.stack([part / total for part in parts], dim=-1)
        return self.triangles.index_select(0, cell), weight

    def _weights_where(self, held: Tensor, w: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """`_weights`, where queries that no cell holds take the nearest direction."""
        outside = torch.nonzero(~held).squeeze(-1)
        nearest = (w[outside] @ self.directions.to(w.dtype).T).argmax(dim=-1)
        index = nearest.new_zeros(w.shape)
        weight = torch.zeros_like(w)
        index[outside] = nearest[:, None]
        weight[outside, 0] = 1.0
        inside = torch.nonzero(held).squeeze(-1)
        if len(inside):
            index[inside], weight[inside] = self._weights(w[inside])
        return index, weight

    def _locate(self, w: Tensor) -> Tensor:
        """The cell that holds each query `[Q]`; -1 where none does."""
        if not len(self.triangles):
            return torch.full_like(w[:, 0], -1, dtype=torch.long)
        square = map_square(w)
        best = self.candidates[0].index_select(0, square).clamp(min=0)
        margin = self._margin(best, w)
        pending = torch.nonzero(margin < 0.0).squeeze(-1)
        for rank in self.candidates[1:]:
            other = rank[square[pending]]
            pending, other = pending[other >= 0], other[other >= 0]
            if not len(pending):
                break
            found = self._margin(other, w[pending])
            better = found > margin[pending]
            best[pending[better]], margin[pending[better]] = other[better], found[better]
            pending = pending[margin[pending] < 0.0]
        lost = torch.nonzero(margin <= -EDGE_TOLERANCE).squeeze(-1)
        for block in lost.split(QUERY_BLOCK):
            best[block] = self._search(w[block])
        return best

    def _search(self, w: Tensor) -> Tensor:
        """`_locate` by comparison with all cells."""
        matrices = self.inverse.to(w.dtype).view(3, 3, -1)
        raw = torch.einsum("abf,qb->qfa", matrices, w)  # [Q, F, 3]
        best = raw.amin(dim=-1).argmax(dim=-1)
        return torch.where(self._margin(best, w) > -EDGE_TOLERANCE, best, -1)

    def _margin(self, cell: Tensor, w: Tensor) -> Tensor:
        """How far inside of its cell each query lies, `[Q]`; below 0 where it does not.

        Minus infinity where only -z, which has no value, would count.
        """
        raw = self._barycentric(cell, w)
        first, second, third = self._shares(cell, raw)
        least = torch.minimum(torch.minimum(raw[0], raw[1]), raw[2])
        return torch.where(first + second + third > EDGE_TOLERANCE, least, -torch.inf)

    def _barycentric(self, cell: Tensor, w: Tensor) -> list[Tensor]:
        """Unnormalized barycentric weights of queries `[Q, 3]` in their cells `[Q]`, `[Q]` each."""
        x, y, z = w.T.contiguous()
        m = [entry.index_select(0, cell) for entry in self.inverse.to(w.dtype)]
        return [m[k] * x + m[k + 1] * y + m[k + 2] * z for k in (0, 3, 6)]

    def _shares(self, cell: Tensor, raw: list[Tensor]) -> list[Tensor]:
        """What the corners of cells `[Q]` share in queries of barycentric weights `raw`."""
        first, second, third = (part.clamp(min=0.0) for part in raw)
        return [first, second, third * self.third.to(third.dtype).index_select(0, cell)]


def map_square(w: Tensor) -> Tensor:
    """The square `[Q]` of the map that upper directions `[Q, 3]` fall into."""
    upper = torch.cat((w[:, :2], w[:, 2:].clamp(min=0.0)), dim=1)
    place = ((disk_from_normal(upper) + 1.0) * (0.5 * MAP_SIZE)).long().clamp(0, MAP_SIZE - 1)
    return place[:, 1] * MAP_SIZE + place[:, 0]


@lru_cache(maxsize=16)
def _built(content: bytes, dtype: torch.dtype) -> HemisphereInterpolation:
    """The interpolation of the directions whose numbers are `content`, on the CPU.

    Kept, because lights and views, and a model and its edited copies, often share directions.
    """
    directions = torch.frombuffer(bytearray(content), dtype=dtype).view(-1, 3)
    points = directions.double()
    triangles = torch.from_numpy(_triangulate(points.numpy()))  # [F, 3]
    edges = _lower_boundary(triangles, points)  # [E, 2]
    down = torch.tensor((0.0, 0.0, -1.0), dtype=torch.float64).expand(len(edges), 1, 3)
    corners = torch.cat((points[triangles], torch.cat((points[edges], down), dim=1)))
    cells = torch.cat((triangles, edges[:, [0, 1, 0]]))
    third = torch.arange(len(cells)) < len(triangles)
    usable = torch.linalg.det(corners).abs() > MIN_TRIANGLE_VOLUME
    inverse = torch.linalg.inv(corners[usable].transpose(1, 2))
    entries = inverse.to(dtype).flatten(1).T.contiguous()  # [9, F]
    return HemisphereInterpolation(
        directions, cells[usable], entries, third[usable].to(dtype), _candidates(inverse)
    )


def _candidates(inverse: Tensor) -> Tensor:
    """`HemisphereInterpolation.candidates` of cells `[F, 3, 3]`: none that matters is left out."""
    if not len(inverse):
        return torch.full((1, MAP_SIZE * MAP_SIZE), -1)
    step = (torch.arange(MAP_SIZE, dtype=torch.float64) + 0.5) * (2.0 / MAP_SIZE) - 1.0
    disk = torch.cartesian_prod(step, step).flip(1)  # [S, 2], rows of y
    margin = torch.cat([_margins_near(inverse, part) for part in disk.split(QUERY_BLOCK // 8)])
    most = max(1, int((margin > -torch.inf).sum(dim=1).max()))
    value, cell = margin.topk(most, dim=1)
    return torch.where(value > -torch.inf, cell, -1).T.contiguous()


def _margins_near(inverse: Tensor, disk: Tensor) -> Tensor:
    """How far inside of each cell squares about `disk [S, 2]` lie; -inf outside: `[S, F]`.

    A weight is linear in the direction, so within a square it differs from that at the centre by
    no more than its slope times the radius of the square. What lies out of the disk is never met.
    """
    centre = normal_from_disk(disk / disk.norm(dim=1, keepdim=True).clamp(min=1.0))  # [S, 3]
    weight = torch.einsum("fab,sb->sfa", inverse, centre)  # [S, F, 3]
    reach = inverse.norm(dim=2) * (DISK_STRETCH * math.sqrt(2.0) / MAP_SIZE)  # [F, 3]
    overlaps = (weight + reach > 0.0).all(dim=-1)
    return torch.where(overlaps, weight.amin(dim=-1), -torch.inf).float()


def _lower_boundary(triangles: Tensor, points: Tensor) -> Tensor:
    """Edges `[E, 2]` of just one of `triangles [F, 3]`, with all `points [N, 3]` above them."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).sort(dim=1).values
    unique, count = torch.unique(edges, dim=0, return_counts=True)
    outer = unique[count == 1]
    side = torch.linalg.cross(points[outer[:, 0]], points[outer[:, 1]])  # normal of edge's plane
    return outer[side[:, 2] * (side @ points.mean(dim=0)) > 0.0]


def _triangulate(points: np.ndarray) -> np.ndarray:
    """Triangles `[F, 3]` of the upper side of the hull of unit vectors `[N, 3]`."""
    if len(points) < 3:
        return np.empty((0, 3), dtype=np.int64)
    if len(points) == 3:
        return np.array([[0, 1, 2]])
    try:
        hull = ConvexHull(points)
    except QhullError:  # all points on one circle, so flat in space
        return _triangulate_flat(points)
    return hull.simplices[hull.equations[:, 3] < -MIN_TRIANGLE_VOLUME].astype(np.int64)


def _triangulate_flat(points: np.ndarray) -> np.ndarray:
    """Triangles of directions on one circle, in the plane that holds it; none if they line up."""
    centred = points - points.mean(axis=0)
    plane = centred @ np.linalg.svd(centred)[2][:2].T
    if np.linalg.matrix_rank(plane, tol=1e-9) < 2:
        return np.empty((0, 3), dtype=np.int64)
    return Delaunay(plane).simplices.astype(np.int64)
