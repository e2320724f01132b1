"""Conventions of directions, frames and texels.

* z is the surface normal. `wi` (light) and `wo` (view) are unit vectors away from the surface.
* Angles are radians; degrees appear only in file names and on the command line.
* theta is polar from z, phi counter-clockwise from +x seen from +z:
  `(theta, phi) = (pi/2, 0)` is +x, `(pi/2, pi/2)` is +y.
* Image row 0 is the top; u runs right (+x), v runs up (+y); texel t = row * W + column, and its
  centre lies at `u = (column + 1/2) / W`, `v = 1 - (row + 1/2) / H`.
* Direction pairs are ordered d = view * L + light.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# Largest polar angle of a lobe's normal: at the horizon a lobe would light nothing.
MAX_TILT = math.radians(85.0)
# Radius of MAX_TILT on the equal-area disk, where r^2 = 1 - cos(theta).
MAX_DISK_RADIUS = math.sqrt(1.0 - math.cos(MAX_TILT))

# Directions that are compared with all others at once: no table of thousands of squares.
NEIGHBOUR_ROWS = 1 << 10

# Rings of measured directions, (polar angle in degrees, number of directions).
UBO2003_RINGS = ((0.0, 1), (15.0, 6), (30.0, 12), (45.0, 18), (60.0, 20), (75.0, 24))
UBO2014_RINGS = (
    (0.0, 1),
    (11.0, 6),
    (23.5, 12),
    (30.0, 12),
    (37.5, 12),
    (45.0, 18),
    (52.5, 18),
    (60.0, 24),
    (67.5, 24),
    (75.0, 24),
)

# How a texture continues beyond its border.
REPEAT, MIRROR = "repeat", "mirror"
RULES = (REPEAT, MIRROR)
CLAMP = "clamp"  # of lookups only: the border's texels go on for ever


def direction_from_angles(theta: Tensor, phi: Tensor) -> Tensor:
    """Unit vectors `[..., 3]` of polar angle theta `[...]` and azimuth phi `[...]`, in radians."""
    sin_theta = torch.sin(theta)
    return torch.stack(
        (sin_theta * torch.cos(phi), sin_theta * torch.sin(phi), torch.cos(theta)), dim=-1
    )


def ring_directions(rings: tuple[tuple[float, int], ...] = UBO2003_RINGS) -> Tensor:
    """Unit vectors `[N, 3]` of rings (polar angle in degrees, count), with azimuths from 0."""
    angles = [
        (math.radians(polar), 2.0 * math.pi * step / count)
        for polar, count in rings
        for step in range(count)
    ]
    theta, phi = torch.tensor(angles, dtype=torch.float64).unbind(-1)
    return direction_from_angles(theta, phi).float()


def direction_pairs(light: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:
    """All pairs (wi `[D, 3]`, wo `[D, 3]`) of L lights and V views, d = view * L + light."""
    wi = light.repeat(view.shape[0], 1)
    wo = view.repeat_interleave(light.shape[0], dim=0)
    return wi, wo


def angular_spacing(directions: Tensor) -> float:
    """Median angle in radians from each of `directions [N, 3]` to its nearest neighbour.

    The result is pi/2 for a single direction, which has no neighbour.
    """
    if directions.shape[0] < 2:
        return math.pi / 2.0
    exact = directions.double()
    nearest = []
    for first in range(0, len(exact), NEIGHBOUR_ROWS):
        rows = exact[first : first + NEIGHBOUR_ROWS]
        cosines = rows @ exact.T
        cosines.diagonal(first).fill_(-1.0)  # of each direction with itself
        nearest.append(cosines.amax(dim=1))
    return float(torch.arccos(torch.cat(nearest).clamp(-1.0, 1.0)).median())


def half_vectors(wi: Tensor, wo: Tensor) -> Tensor:
    """Unit half vectors `[..., 3]` of directions `[..., 3]`."""
    return torch.nn.functional.normalize(wi + wo, dim=-1)


def normal_from_disk(disk: Tensor) -> Tensor:
    """Normals `[..., 3]` of points `[..., 2]` on Lambert's equal-area disk, |disk| <= 1.

    The map is smooth, with a finite gradient over the whole closed upper hemisphere; therefore the
    search moves normals on the disk.
    """
    if disk.is_cuda and not torch.is_grad_enabled():  # the same in fewer operations
        squares = disk * disk
        squared = squares[..., :1] + squares[..., 1:]
        return torch.cat((disk * torch.sqrt(2.0 - squared), 1.0 - squared), dim=-1)
    x, y = disk.unbind(-1)
    squared = x * x + y * y
    stretch = torch.sqrt(2.0 - squared)
    return torch.stack((x * stretch, y * stretch, 1.0 - squared), dim=-1)


def disk_from_normal(normal: Tensor) -> Tensor:
    """Points `[..., 2]` on Lambert's equal-area disk of upper unit normals `[..., 3]`."""
    return normal[..., :2] / torch.sqrt(1.0 + normal[..., 2:])


def project_disk(disk: Tensor) -> Tensor:
    """The points `[..., 2]` nearest to `disk [..., 2]` with normals tilted by at most MAX_TILT."""
    radius = disk.norm(dim=-1, keepdim=True)
    return disk * (MAX_DISK_RADIUS / radius.clamp(min=MAX_DISK_RADIUS))


def frame_from_normal(normal: Tensor, angle: Tensor) -> Tensor:
    """Rotations `[..., 3, 3]` from global to local coordinates.

    Rows are tangent, bitangent and normal. The global frame is rotated along the shortest way that
    takes z to `normal [..., 3]`, then about the normal by `angle [...]` (radians,
    counter-clockwise).
    """
    if normal.is_cuda and not torch.is_grad_enabled():  # the same in fewer operations
        planar = normal[..., :2]
        across = -planar
        scale = (1.0 + normal[..., 2:, None]).reciprocal()
        upper = across[..., :, None] * planar[..., None, :] * scale  # [..., 2, 2]
        upper.diagonal(dim1=-2, dim2=-1).add_(1.0)
        tangents = torch.cat((upper, across[..., None]), dim=-1)  # [..., 2, 3]
        turned = torch.stack((tangents[..., 1, :], -tangents[..., 0, :]), dim=-2)
        angle = angle[..., None, None]
        tangents = torch.cos(angle) * tangents + torch.sin(angle) * turned
        return torch.cat((tangents, normal[..., None, :]), dim=-2)
    x, y, z = normal.unbind(-1)
    scale = 1.0 / (1.0 + z)
    tangent = torch.stack((1.0 - x * x * scale, -x * y * scale, -x), dim=-1)
    bitangent = torch.stack((-x * y * scale, 1.0 - y * y * scale, -y), dim=-1)
    cosine, sine = torch.cos(angle)[..., None], torch.sin(angle)[..., None]
    return torch.stack(
        (cosine * tangent + sine * bitangent, cosine * bitangent - sine * tangent, normal), dim=-2
    )


def hemisphere_spiral(count: int, max_theta: float = MAX_TILT) -> Tensor:
    """Normals `[count, 3]` on a Fibonacci spiral, uniform by area up to `max_theta` (radians)."""
    step = torch.arange(count, dtype=torch.float64)
    cos_theta = 1.0 - (step + 0.5) / count * (1.0 - math.cos(max_theta))
    golden = math.pi * (3.0 - math.sqrt(5.0))
    return direction_from_angles(torch.arccos(cos_theta), step * golden).float()


def texel_at(uv: Tensor, height: int, width: int, rule: str = REPEAT) -> tuple[Tensor, Tensor]:
    """The four texels around uv `[..., 2]` and their bilinear weights; the first tells the others.

    Args:
        uv: texture coordinates, u right, v up.
        height, width: texels of the texture.
        rule: how the texture continues beyond its border, one of `RULES`.

    Returns:
        (index `[..., 4]`, weight `[..., 4]`).
    """
    column = uv[..., 0] * width - 0.5
    row = (1.0 - uv[..., 1]) * height - 0.5
    if rule == MIRROR:
        column, row = mirrored(column, width), mirrored(row, height)
    left, top = torch.floor(column), torch.floor(row)
    right, bottom = column - left, row - top  # weights
    left, top = left.long(), top.long()
    columns = continued(torch.stack((left, left + 1), dim=-1), width, rule)  # [..., 2]
    rows = continued(torch.stack((top, top + 1), dim=-1), height, rule)  # [..., 2]
    across = torch.stack((1.0 - right, right), dim=-1)
    down = torch.stack((1.0 - bottom, bottom), dim=-1)
    index = rows[..., :, None] * width + columns[..., None, :]  # [..., 2, 2]
    weight = down[..., :, None] * across[..., None, :]
    return index.flatten(-2), weight.flatten(-2)


def continued(index: Tensor, count: int, rule: str) -> Tensor:
    """The row or column `[...]` of the texture that stands at any whole number `index [...]`.

    Args:
        index: rows or columns, beyond the border too.
        count: rows or columns of the texture.
        rule: `repeat`, or `mirror`: every second copy is reversed.
    """
    if rule == REPEAT:
        return index % count
    place = index % (2 * count)
    return torch.minimum(place, 2 * count - 1 - place)


def mirrored(at: Tensor, count: int) -> Tensor:
    """The place `[...]` between the first and last of `count` centres that looks as `at [...]`."""
    edge = torch.remainder(at + 0.5, 2 * count)
    return (torch.minimum(edge, 2 * count - edge) - 0.5).clamp(0.0, count - 1.0)


def turn(at: Tensor, count: int, rule: str) -> Tensor:
    """The derivative `[...]` of the place that `texel_at` reads by a place `at [...]`.

    1, or with `mirror` -1 in reversed copies, and 0 beyond the last centres, where nothing changes.

    Args:
        at: rows or columns, 0 at the centre of the first.
        count: rows or columns of the texture.
        rule: one of `RULES`.
    """
    if rule != MIRROR:
        return torch.ones_like(at)
    edge = torch.remainder(at + 0.5, 2 * count)
    place = torch.minimum(edge, 2 * count - edge) - 0.5
    sign = torch.where(edge < count, 1.0, -1.0).to(at.dtype)
    return sign * ((place >= 0.0) & (place <= count - 1.0))
