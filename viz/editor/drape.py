"""A patch of draped cloth, to judge a material on folds."""

from __future__ import annotations

import torch
from torch import Tensor

from ...render.shapes import Rays, Texture

# Folds z = sum of a sin(kx x + ky y + shift), as rows (a, kx, ky, shift), and a sag to the edges.
FOLDS = ((0.10, 3.4, 1.1, 0.4), (0.055, 6.1, -2.3, 1.7), (0.03, 2.0, 7.0, 0.9))
SAG = 0.16
# Bounds of the heights of the cloth.
LOW, HIGH = -0.55, 0.25
# Steps along a ray that find the fold it meets, and halvings that then find the point.
STEPS, HALVINGS = 40, 12


class Drape:
    """The height field over -1 to 1 in x and y, seen from +z; a shape like `render.shapes.Plane`.

    Args:
        texture: how the texture lies on it, as on a plane.
    """

    axis = (0.0, 0.0, 1.0)

    def __init__(self, texture: Texture) -> None:
        self.texture = texture

    def distance(self, rays: Rays) -> Tensor:
        """Distance `[R]` at which each ray first meets the cloth; infinite where it misses."""
        z = rays.direction[:, 2]
        faces = z < 0.0
        down = torch.where(faces, z, -1.0)
        near = (HIGH - rays.origin[:, 2]) / down
        step = (LOW - HIGH) / down / STEPS  # [R]
        number = torch.arange(1, STEPS + 1, device=z.device)
        under = self._gap(rays, near[:, None] + step[:, None] * number) < 0.0  # [R, STEPS]
        first = under.to(torch.uint8).argmax(dim=1)
        low = near + step * first  # still over the cloth
        high = low + step
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = self._gap(rays, middle[:, None])[:, 0] < 0.0
            low, high = torch.where(below, low, middle), torch.where(below, middle, high)
        position = rays.origin + high[:, None] * rays.direction
        on = (position[:, :2].abs() <= 1.0).all(-1)
        return torch.where(faces & under.any(1) & (near > 0.0) & on, high, torch.inf)

    def surface(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Local frames `[N, 3, 3]` (rows tangent, bitangent, normal) and uv `[N, 2]`."""
        x, y = position[:, 0], position[:, 1]
        gradient_x, gradient_y = -2.0 * SAG * x, -2.0 * SAG * y
        for height, kx, ky, shift in FOLDS:
            wave = height * torch.cos(kx * x + ky * y + shift)
            gradient_x, gradient_y = gradient_x + kx * wave, gradient_y + ky * wave
        one, zero = torch.ones_like(x), torch.zeros_like(x)
        normal = _unit(torch.stack((-gradient_x, -gradient_y, one), dim=-1))
        tangent = _unit(torch.stack((one, zero, gradient_x), dim=-1))
        frame = torch.stack((tangent, torch.linalg.cross(normal, tangent), normal), dim=-2)
        return frame, self.texture.at(0.5 * x, 0.5 * y)

    def holds(self, point: Tensor) -> bool:
        """Whether a point `[3]` lies inside: never, for a cloth."""
        return False

    def _gap(self, rays: Rays, distance: Tensor) -> Tensor:
        """Height over the cloth `[R, n]` of points at `distance [R, n]` along rays."""
        at = rays.origin[:, None] + distance[..., None] * rays.direction[:, None]
        return at[..., 2] - height(at[..., 0], at[..., 1])


def height(x: Tensor, y: Tensor) -> Tensor:
    """z `[...]` of the cloth over x and y `[...]`."""
    z = -SAG * (x * x + y * y)
    for amplitude, kx, ky, shift in FOLDS:
        z = z + amplitude * torch.sin(kx * x + ky * y + shift)
    return z


def _unit(vector: Tensor) -> Tensor:
    return vector / vector.norm(dim=-1, keepdim=True)
