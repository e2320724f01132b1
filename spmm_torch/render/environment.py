"""Environment light: a latitude-longitude map, its reader, and a built-in studio.

Maps are oriented as OpenEXR defines: the top row is +y, the middle is +z, the middle of the left
half is +x, so that an observer inside sees them unmirrored. Radiance is constant within a pixel,
which makes the sampling exact [Pharr et al., Physically Based Rendering, 12.5].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ..data.codecs import CODECS, DECODE_ERRORS, codec_of, is_linear
from ..errors import DataError

# Relative luminance of linear sRGB primaries [ITU-R BT.709].
LUMINANCE = (0.2126, 0.7152, 0.0722)
# Rows of the studio's map; it has twice as many columns.
STUDIO_ROWS = 64
# Radiance of its walls at the bottom and at the top.
STUDIO_FLOOR, STUDIO_CEILING = 0.05, 0.25
# Its soft boxes: (azimuth from +z towards +x and elevation of the centre, half width and half
# height, all in degrees; RGB): a warm key light, a cool and wide fill light, a rim light behind.
SOFT_BOXES = (
    ((40.0, 40.0), (18.0, 18.0), (8.0, 7.6, 7.0)),
    ((-60.0, 15.0), (25.0, 30.0), (1.3, 1.4, 1.6)),
    ((160.0, 35.0), (20.0, 12.0), (5.0, 5.0, 5.0)),
)


@dataclass(frozen=True)
class EnvironmentLight:
    """Radiance from every direction.

    Attributes:
        picture: radiance `[H, W, 3]`.
        rows: fraction of the power in each row and all above it, `[H]` float64.
        cells: row number plus the fraction of its power in each pixel and all left of it,
            `[H * W]` float64; rising, so that one search finds a pixel in any row.
        density: solid-angle density of sampling each pixel, `[H * W]` float64, in 1/sr.
        rotation: from map axes to world axes, `[3, 3]` float64.
    """

    picture: Tensor
    rows: Tensor
    cells: Tensor
    density: Tensor
    rotation: Tensor

    @classmethod
    def build(cls, picture: Tensor, name: str = "the environment map") -> EnvironmentLight:
        """The light of a latitude-longitude map `[H, W, 3]`.

        Raises:
            DataError: the map has another shape, or is not finite, negative or black.
        """
        _check_radiance(picture, name)
        height, width = picture.shape[:2]
        solid_angle = _map_directions(height, width, picture.device)[1]  # [H]
        power = cls.luminance(picture.double()) * solid_angle[:, None]  # [H, W]
        row_power = power.sum(1)
        fraction = power / row_power.clamp(min=torch.finfo(torch.float64).tiny)[:, None]
        ascending = torch.arange(height, dtype=torch.float64, device=picture.device)
        cells = fraction.cumsum(1).clamp(max=1.0)
        rows = (row_power / row_power.sum()).cumsum(0)
        cells[:, -1] = rows[-1] = 1.0  # despite rounding, and in black rows
        cells = cells + ascending[:, None]
        density = power / (row_power.sum() * solid_angle[:, None])
        rotation = torch.eye(3, dtype=torch.float64)
        return cls(picture, rows, cells.flatten(), density.flatten(), rotation)

    @classmethod
    def read(cls, path: Path | str) -> EnvironmentLight:
        """The light of an OpenEXR, Radiance or float TIFF picture.

        Raises:
            DataError: the file cannot be read, or holds no valid light.
        """
        try:
            payload = Path(path).read_bytes()
            picture = _decode(payload)
        except DECODE_ERRORS as error:
            raise DataError(
                f"environment map {path} cannot be read ({error}); expected an OpenEXR, "
                f"Radiance or float TIFF picture (.exr, .hdr, .tif) in latitude-longitude format; "
                f"check the file."
            ) from error
        return cls.build(picture, f"environment map {path}")

    @classmethod
    def studio(cls) -> EnvironmentLight:
        """The built-in studio: three soft boxes between dim walls."""
        return cls.build(studio_picture(STUDIO_ROWS), "the studio")

    def to(self, device: torch.device | str, dtype: torch.dtype) -> EnvironmentLight:
        """The same light on a device, with radiance of a dtype."""
        parts = (part.to(device) for part in (self.rows, self.cells, self.density, self.rotation))
        return EnvironmentLight(self.picture.to(device, dtype), *parts)

    def rotated(self, rotation: Tensor) -> EnvironmentLight:
        """The light turned by a rotation `[3, 3]` of the world."""
        return replace(self, rotation=rotation.to(self.rotation.device) @ self.rotation)

    def sample(self, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Directions `[..., 3]`, radiance `[..., 3]` and pdf `[...]` of u `[..., 2]` in [0, 1)."""
        height, width = self.picture.shape[:2]
        row, down = _search(self.rows, u[..., 0].double())
        row = row.clamp(max=height - 1)
        # Rounding must not lead to the neighbouring row.
        cell, right = _search(self.cells, row + u[..., 1].double())
        cell = torch.minimum(torch.maximum(cell, row * width), row * width + width - 1)
        top = torch.cos(row * (math.pi / height))
        bottom = torch.cos((row + 1) * (math.pi / height))
        y = top + (bottom - top) * down
        longitude = math.pi - (cell - row * width + right) * (2.0 * math.pi / width)
        radius = torch.sqrt((1.0 - y * y).clamp(min=0.0))
        local = torch.stack((radius * torch.sin(longitude), y, radius * torch.cos(longitude)), -1)
        direction = (local @ self.rotation.T).to(u.dtype)
        value = self.picture.reshape(-1, 3)[cell].to(u.dtype)
        return direction, value, self.density[cell].to(u.dtype)

    def pdf(self, direction: Tensor) -> Tensor:
        """Density `[...]` in 1/sr with which `sample` yields unit directions `[..., 3]`."""
        return self.density[self._pixel(direction)].to(direction.dtype)

    def radiance(self, direction: Tensor) -> Tensor:
        """RGB `[..., 3]` from unit directions `[..., 3]`."""
        return self.picture.reshape(-1, 3)[self._pixel(direction)].to(direction.dtype)

    def points(self, count: int) -> tuple[Tensor, Tensor]:
        """(unit directions `[N, 3]`, power `[N, 3]`) of about `count` points, float64.

        They are the pixels of the map: divided if they are fewer, averaged over blocks if they are
        more. Directions are in world axes; power is radiance times solid angle.
        """
        picture = self.picture.double()
        side = math.sqrt(picture.shape[0] * picture.shape[1] / count)
        block, parts = math.ceil(side), max(1, math.floor(1.0 / side))
        picture = picture.repeat_interleave(parts, 0).repeat_interleave(parts, 1)
        height, width = picture.shape[:2]
        direction, solid_angle = _map_directions(height, width, picture.device)
        power = picture * solid_angle[:, None, None]
        if block > 1:
            weight = self.luminance(power)[..., None]
            direction = _block_sums(direction * weight, block)
            direction = direction + torch.finfo(torch.float64).tiny  # of black blocks
            power = _block_sums(power, block)
        direction = direction / direction.norm(dim=-1, keepdim=True)
        return direction.reshape(-1, 3) @ self.rotation.T, power.reshape(-1, 3)

    @staticmethod
    def luminance(rgb: Tensor) -> Tensor:
        """Relative luminance `[...]` of RGB `[..., 3]` [ITU-R BT.709]."""
        return rgb @ torch.tensor(LUMINANCE, dtype=rgb.dtype, device=rgb.device)

    def _pixel(self, direction: Tensor) -> Tensor:
        """Index `[...]` of the pixel in each direction."""
        height, width = self.picture.shape[:2]
        x, y, z = (direction @ self.rotation.to(direction.dtype)).unbind(-1)
        row = torch.arccos(y.clamp(-1.0, 1.0)) * (height / math.pi)
        column = (0.5 - torch.atan2(x, z) / (2.0 * math.pi)) * width
        row, column = row.long().clamp(max=height - 1), column.long().clamp(0, width - 1)
        return row * width + column


def studio_picture(rows: int) -> Tensor:
    """The map `[rows, 2 * rows, 3]` of the studio."""
    polar = (torch.arange(rows) + 0.5) * (math.pi / rows)
    longitude = math.pi - (torch.arange(2 * rows) + 0.5) * (math.pi / rows)
    elevation = torch.rad2deg(0.5 * math.pi - polar)[:, None]  # [H, 1]
    azimuth = torch.rad2deg(longitude)  # [W]
    wall = STUDIO_FLOOR + (STUDIO_CEILING - STUDIO_FLOOR) * (elevation + 90.0) / 180.0
    picture = wall[..., None].expand(rows, 2 * rows, 3).clone()
    for (across, up), (half_width, half_height), rgb in SOFT_BOXES:
        away = (azimuth - across + 180.0) % 360.0 - 180.0
        inside = (away.abs() < half_width) & ((elevation - up).abs() < half_height)
        picture[inside] = torch.tensor(rgb)
    return picture


def _map_directions(height: int, width: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """(directions of pixels in map axes `[H, W, 3]`, their solid angle by row `[H]`), float64."""
    edges = torch.cos(torch.linspace(0.0, math.pi, height + 1, dtype=torch.float64))
    polar = (torch.arange(height, dtype=torch.float64) + 0.5) * (math.pi / height)
    longitude = math.pi - (torch.arange(width, dtype=torch.float64) + 0.5) * (2.0 * math.pi / width)
    radius = torch.sin(polar)[:, None]
    y = torch.cos(polar)[:, None].expand(height, width)
    direction = torch.stack((radius * torch.sin(longitude), y, radius * torch.cos(longitude)), -1)
    solid_angle = (edges[:-1] - edges[1:]) * (2.0 * math.pi / width)
    return direction.to(device), solid_angle.to(device)


def _block_sums(values: Tensor, block: int) -> Tensor:
    """Sums `[h, w, 3]` of `values [H, W, 3]` over blocks of `block` x `block`, cut at the edges."""
    rows, columns = (torch.arange(n, device=values.device) // block for n in values.shape[:2])
    shape = (int(rows[-1]) + 1, int(columns[-1]) + 1, 3)
    by_row = values.new_zeros(shape[0], values.shape[1], 3).index_add_(0, rows, values)
    return values.new_zeros(shape).index_add_(1, columns, by_row)


def _search(cumulative: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """The cell `[...]` that u `[...]` falls into, and its place within the cell, 0 to 1."""
    cell = torch.searchsorted(cumulative, u.contiguous(), right=True)
    cell = cell.clamp(max=len(cumulative) - 1)
    low = torch.where(cell > 0, cumulative[(cell - 1).clamp(min=0)], 0.0)
    high = cumulative[cell]
    # The first cell of a row starts at the whole number that ends the row above.
    place = (u - low) / (high - low).clamp(min=torch.finfo(torch.float64).tiny)
    return cell, place.clamp(0.0, 1.0)


def _decode(payload: bytes) -> Tensor:
    """Radiance `[H, W, 3]` float32 of the content of a file."""
    codec = codec_of(payload)
    if not codec.HDR:
        raise ValueError(f"it is neither {' nor '.join(each.TITLE for each in CODECS if each.HDR)}")
    codes, expand = torch.from_numpy(codec.decode(payload)), codec.expansion(1.0)
    if not is_linear(codes, expand):
        raise ValueError(f"it holds {codes.dtype} codes of a display; expected linear values")
    return expand(codes)


def _check_radiance(picture: Tensor, name: str) -> None:
    if picture.dim() != 3 or picture.shape[2] != 3 or 0 in picture.shape:
        raise DataError(f"{name} has shape {list(picture.shape)}; expected [height, width, 3].")
    if not bool(picture.isfinite().all()):
        raise DataError(f"{name} holds values that are not finite; expected radiance; mend it.")
    if bool((picture < 0.0).any()):
        low = float(picture.min())
        raise DataError(f"{name} holds negative radiance ({low:g}); expected 0 or more; mend it.")
    if not bool(picture.any()):
        raise DataError(f"{name} is all black; expected a light that lights something.")
