"""Interpolation over the hemisphere of values at measured directions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from scipy.spatial import ConvexHull, Delaunay, QhullError
from torch import Tensor

from .directions import (
    direction_from_angles,
    disk_from_normal,
    hemisphere_spiral,
    normal_from_disk,
)

# Smallest determinant of the corners of a triangle that float32 can invert: six times the volume of
# the tetrahedron of the triangle and the origin.
MIN_DETERMINANT = 1e-6
# Height over the origin above which a face of the hull belongs to its upper side.
MIN_FACE_DISTANCE = 1e-6
# Barycentric weight down to which a query outside of all cells, by rounding, belongs to a cell.
EDGE_TOLERANCE = 1e-4
# Squares along each side of the map from directions to candidate cells: far smaller than the
# triangles of measured directions, yet built in some hundredths of a second.
MAP_SIZE = 128
# Largest ratio of the length of a step between directions to that of the step on the disk.
DISK_STRETCH = 2.0
# Squares along a side of the coarse map, by which cells are chosen for the fine one.
COARSE_SIZE = 16
# Directions in the hemisphere, and on the horizon, that are tried for gaps between cells: gaps are
# sectors between the azimuths of measured directions, not smaller than one of these steps.
PROBES = 1024
# Comparisons of queries with all cells, or with all directions, that are made at once: 100 MB.
BLOCK_COMPARISONS = 1 << 23


@dataclass(frozen=True)
class HemisphereInterpolation:
    """Piecewise linear, continuous interpolation of values at N measured directions.

    Triangles are those of the spherical Delaunay triangulation, the upper side of the convex hull.
    A query has the barycentric weights of the plane through its triangle, so that measured
    directions keep their own value. A query below the lowest ring is lifted along z to the edge
    above it. A query that neither covers (fewer than three directions, or directions on one side
    only) takes the value of the nearest direction.

    Attributes:
        directions: measured unit vectors `[N, 3]`.
        triangles: corner indices `[F, 3]` of the cells; the third corner of a lifting cell is
            unused.
        inverse: matrices from a direction to unnormalized barycentric weights, 3 x 3 entries row
            by row for each cell, `[9, F]`.
        third: 1 where the third corner has a value, 0 where it is -z, `[F]`.
        candidates: cells that overlap each square of a map of the equal-area disk, the likeliest
            first, -1 for none, `[rank, MAP_SIZE * MAP_SIZE]`.
        covers: whether the cells hold all directions of the upper hemisphere.
    """

    directions: Tensor
    triangles: Tensor
    inverse: Tensor
    third: Tensor
    candidates: Tensor
    covers: bool

    @classmethod
    def build(cls, directions: Tensor) -> HemisphereInterpolation:
        """The interpolation between upper unit `directions [N, 3]`; cached by their values."""
        host = directions.detach().cpu().contiguous()
        built = _built(host.numpy().tobytes(), host.dtype)
        return built.to(directions.device)

    def to(self, device: torch.device | str) -> HemisphereInterpolation:
        """The same interpolation on another device."""
        parts = {name: part for name, part in vars(self).items() if isinstance(part, Tensor)}
        return replace(self, **{name: part.to(device) for name, part in parts.items()})

    def weights(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """Measured directions around `w [..., 3]` and their weights, which are >= 0 and sum to 1.

        Returns:
            (index `[..., 3]`, weight `[..., 3]`).
        """
        flat = w.reshape(-1, 3)
        index, weight = self._weights(flat)
        return index.reshape(w.shape), weight.reshape(w.shape)

    def weights_of_all(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """`weights` of queries `[Q, 3]` by the same steps for each, without a look at any value.

        It can be compiled and transformed, and takes longer. Directions under the horizon get
        finite weights of no meaning.
        """
        if not len(self.triangles):
            return self._nearest(w)
        cell, margin = self._likeliest(w.detach())
        first, second, third = self._corner_weights(cell, self._barycentric(cell, w))
        total = first + second + third
        held = total > 0.0
        parts = torch.stack((first, second, third), dim=-1)
        weight = torch.where(held, 1.0 / torch.where(held, total, 1.0), 0.0)[..., None] * parts
        index = self.triangles[cell]
        if self.covers:
            return index, weight
        nearest, alone = self._nearest(w)
        inside = (margin > -EDGE_TOLERANCE)[..., None]
        return torch.where(inside, index, nearest), torch.where(inside, weight, alone)

    def _likeliest(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """The candidate that holds each query best, and its margin, `[Q]`; see `_locate`."""
        square = map_square(w)
        best = self.candidates[0][square].clamp(min=0)
        margin = self._margin(best, w)
        for rank in self.candidates[1:]:
            other = rank[square]
            found = self._margin(other.clamp(min=0), w)
            better = (margin < 0.0) & (other >= 0) & (found > margin)
            best, margin = torch.where(better, other, best), torch.where(better, found, margin)
        return best, margin

    def _nearest(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """The measured direction nearest to each query `[Q, 3]`, as `weights` gives it."""
        likeness = (w[:, None] * self.directions.to(w.dtype)).sum(-1)  # [Q, N]
        index = likeness.argmax(dim=-1)
        first = torch.arange(3, device=w.device) == 0
        weight = first.to(w.dtype).expand_as(w)
        return index[:, None].expand(-1, 3), weight

    def _weights(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """`weights` of queries `[Q, 3]`."""
        with torch.no_grad():
            cell = self._locate(w)  # [Q]
        held = cell >= 0
        if not bool(held.all()):
            return self._weights_where(held, w, cell)
        parts = self._corner_weights(cell, self._barycentric(cell, w))
        total = parts[0] + parts[1] + parts[2]
        weight = torch.stack([part / total for part in parts], dim=-1)
        return self.triangles.index_select(0, cell), weight

    def _weights_where(self, held: Tensor, w: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """`_weights`, with the nearest direction for queries that no cell holds."""
        outside = torch.nonzero(~held).squeeze(-1)
        known = self.directions.to(w.dtype).T
        rows = max(1, BLOCK_COMPARISONS // known.shape[1])
        nearest = torch.cat([(w[part] @ known).argmax(dim=-1) for part in outside.split(rows)])
        index = nearest.new_zeros(w.shape)
        weight = torch.zeros_like(w)
        index[outside] = nearest[:, None]
        weight[outside, 0] = 1.0
        inside = torch.nonzero(held).squeeze(-1)
        if len(inside):
            index[inside], weight[inside] = self._weights(w[inside])
        return index, weight

    def _locate(self, w: Tensor) -> Tensor:
        """The cell `[Q]` that holds each query `[Q, 3]`; -1 where none does."""
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
        for block in lost.split(max(1, BLOCK_COMPARISONS // len(self.triangles))):
            best[block] = self._search(w[block])
        return best

    def _search(self, w: Tensor) -> Tensor:
        """The cell `[Q]` as by `_locate`, found by comparison with all cells."""
        matrices = self.inverse.to(w.dtype).view(3, 3, -1)
        raw = torch.einsum("abf,qb->qfa", matrices, w)  # [Q, F, 3]
        best = raw.amin(dim=-1).argmax(dim=-1)
        return torch.where(self._margin(best, w) > -EDGE_TOLERANCE, best, -1)

    def _margin(self, cell: Tensor, w: Tensor) -> Tensor:
        """The smallest barycentric weight `[Q]` of each query in its cell; negative outside of it.

        Minus infinity where all weight would be on -z, which has no value.
        """
        raw = self._barycentric(cell, w)
        first, second, third = self._corner_weights(cell, raw)
        least = torch.minimum(torch.minimum(raw[0], raw[1]), raw[2])
        return torch.where(first + second + third > EDGE_TOLERANCE, least, -torch.inf)

    def _barycentric(self, cell: Tensor, w: Tensor) -> list[Tensor]:
        """Three unnormalized barycentric weights `[Q]` of queries `[Q, 3]` in cells `[Q]`."""
        x, y, z = w.T.contiguous()
        m = [entry.index_select(0, cell) for entry in self.inverse.to(w.dtype)]
        return [m[k] * x + m[k + 1] * y + m[k + 2] * z for k in (0, 3, 6)]

    def _corner_weights(self, cell: Tensor, raw: list[Tensor]) -> list[Tensor]:
        """The weights of the corners of cells `[Q]`: `raw` without negative parts and -z."""
        first, second, third = (part.clamp(min=0.0) for part in raw)
        return [first, second, third * self.third.to(third.dtype).index_select(0, cell)]


def map_square(w: Tensor) -> Tensor:
    """The map's square `[Q]` of each upper direction `[Q, 3]`."""
    upper = torch.cat((w[:, :2], w[:, 2:].clamp(min=0.0)), dim=1)
    place = ((disk_from_normal(upper) + 1.0) * (0.5 * MAP_SIZE)).long().clamp(0, MAP_SIZE - 1)
    return place[:, 1] * MAP_SIZE + place[:, 0]


@lru_cache(maxsize=16)
def _built(content: bytes, dtype: torch.dtype) -> HemisphereInterpolation:
    """The interpolation, on the CPU, between the directions whose bytes are `content`.

    Cached, as lights and views, or a model and its edited copies, often have the same directions.
    """
    directions = torch.frombuffer(bytearray(content), dtype=dtype).view(-1, 3)
    points = directions.double()
    triangles = torch.from_numpy(_triangulate(points.numpy()))  # [F, 3]
    edges = _lower_boundary(triangles, points)  # [E, 2]
    down = torch.tensor((0.0, 0.0, -1.0), dtype=torch.float64).expand(len(edges), 1, 3)
    corners = torch.cat((points[triangles], torch.cat((points[edges], down), dim=1)))
    cells = torch.cat((triangles, edges[:, [0, 1, 0]]))
    third = torch.arange(len(cells)) < len(triangles)
    usable = torch.linalg.det(corners).abs() > MIN_DETERMINANT
    inverse = torch.linalg.inv(corners[usable].transpose(1, 2))
    entries = inverse.to(dtype).flatten(1).T.contiguous()  # [9, F]
    mesh = HemisphereInterpolation(
        directions, cells[usable], entries, third[usable].to(dtype), _candidates(inverse), False
    )
    return replace(mesh, covers=bool((mesh._locate(_probes().to(dtype)) >= 0).all()))


def _probes() -> Tensor:
    """Directions `[n, 3]` that cells hold all of if they leave no gap: a spiral and the horizon."""
    azimuth = torch.arange(PROBES) * (2.0 * math.pi / PROBES)
    horizon = direction_from_angles(torch.full_like(azimuth, 0.5 * math.pi), azimuth)
    horizon[:, 2] = 0.0
    return torch.cat((hemisphere_spiral(PROBES, 0.5 * math.pi), horizon))


def _candidates(inverse: Tensor) -> Tensor:
    """`HemisphereInterpolation.candidates` of cells with matrices `[F, 3, 3]`.

    Squares of a coarse map choose the cells that the squares of the fine one in them are held
    against: 8,000 directions have 16,000 cells, of which few are near.
    """
    side = MAP_SIZE // COARSE_SIZE
    disk = _centres(MAP_SIZE)  # [S, 2]
    inside = torch.arange(MAP_SIZE * MAP_SIZE).view(COARSE_SIZE, side, COARSE_SIZE, side)
    inside = inside.transpose(1, 2).reshape(COARSE_SIZE**2, -1)  # [coarse, fine]
    found = []
    for coarse, squares in zip(_centres(COARSE_SIZE).split(1), inside, strict=True):
        close = _margins_near(inverse, coarse, COARSE_SIZE)[0] > -torch.inf
        near = torch.nonzero(close).squeeze(1)  # [f]
        margin = _margins_near(inverse[near], disk[squares], MAP_SIZE)
        most = int((margin > -torch.inf).sum(dim=1).max()) if len(near) else 0
        value, place = margin.topk(most, dim=1)
        found.append(torch.where(value > -torch.inf, near[place], -1))
    rank = max(1, *(cells.shape[1] for cells in found))
    result = torch.full((rank, MAP_SIZE * MAP_SIZE), -1)
    for squares, cells in zip(inside, found, strict=True):
        result[: cells.shape[1], squares] = cells.T
    return result


def _centres(size: int) -> Tensor:
    """Centres `[size * size, 2]` float64 of the squares of a map of the disk, rows of y."""
    step = (torch.arange(size, dtype=torch.float64) + 0.5) * (2.0 / size) - 1.0
    return torch.cartesian_prod(step, step).flip(1)


def _margins_near(inverse: Tensor, disk: Tensor, size: int) -> Tensor:
    """The smallest weight in each cell at the centres `disk [S, 2]` of squares: `[S, F]`.

    It is -inf where square and cell are apart. A weight is linear in the direction: within a square
    it differs from that at the centre by at most its gradient times the radius of the square. No
    query lies outside of the disk.

    Args:
        inverse: matrices of the cells, `[F, 3, 3]`.
        disk: centres.
        size: number of squares along a side of the map.
    """
    centre = normal_from_disk(disk / disk.norm(dim=1, keepdim=True).clamp(min=1.0))  # [S, 3]
    weight = torch.einsum("fab,sb->sfa", inverse, centre)  # [S, F, 3]
    reach = inverse.norm(dim=2) * (DISK_STRETCH * math.sqrt(2.0) / size)  # [F, 3]
    overlaps = (weight + reach > 0.0).all(dim=-1)
    return torch.where(overlaps, weight.amin(dim=-1), -torch.inf).float()


def _lower_boundary(triangles: Tensor, points: Tensor) -> Tensor:
    """Edges `[E, 2]` of a single one of `triangles [F, 3]`, with all `points [N, 3]` above them."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).sort(dim=1).values
    unique, count = torch.unique(edges, dim=0, return_counts=True)
    outer = unique[count == 1]
    side = torch.linalg.cross(
        points[outer[:, 0]], points[outer[:, 1]]
    )  # normals of the planes of the edges
    return outer[side[:, 2] * (side @ points.mean(dim=0)) > 0.0]


def _triangulate(points: np.ndarray) -> np.ndarray:
    """Triangles `[F, 3]` of the convex hull of unit vectors `[N, 3]`, on its upper side."""
    if len(points) < 3:
        return np.empty((0, 3), dtype=np.int64)
    if len(points) == 3:
        return np.array([[0, 1, 2]])
    try:
        hull = ConvexHull(points)
    except QhullError:  # all points on one circle, so flat in space
        return _triangulate_flat(points)
    return hull.simplices[hull.equations[:, 3] < -MIN_FACE_DISTANCE].astype(np.int64)


def _triangulate_flat(points: np.ndarray) -> np.ndarray:
    """Triangles `[F, 3]` of directions `[N, 3]` on one circle; none if they are on one line."""
    centred = points - points.mean(axis=0)
    plane = centred @ np.linalg.svd(centred)[2][:2].T
    if np.linalg.matrix_rank(plane, tol=1e-9) < 2:
        return np.empty((0, 3), dtype=np.int64)
    return Delaunay(plane).simplices.astype(np.int64)
