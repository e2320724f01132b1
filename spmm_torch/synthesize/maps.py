"""Texture maps: read, checked against each other, and reduced in size."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from ..data.codecs import DECODE_ERRORS, read_picture
from ..errors import DataError

# Largest mean range of the channels of a grey picture saved as RGB: JPEG rounds.
MAX_TINT = 4.0 / 255.0
# Tolerance of the ratio of two aspects: maps may differ in size, and sides are rounded.
SHAPE_TOLERANCE = 0.01
# Smallest z of a normal before it is normalized, so that it faces up.
MIN_NORMAL_Z = 0.05
# Correlation with the heights below which a normal map is upside down; it is then about -1.
UPSIDE_DOWN = -0.2


@dataclass(frozen=True, eq=False)
class TextureMaps:
    """The maps of one periodic texture, of one aspect; row 0 is the top, and sizes may differ.

    Args:
        height: heights `[h, w]` in [0, 1].
        albedo: linear base colours `[h, w, 3]` in [0, 1].
        roughness: roughness `[h, w]` in [0, 1], the square root of the microfacet width alpha.
        metallic: metallic weights `[h, w]` in [0, 1]; None: no metal.
        normal: unit shading normals `[h, w, 3]`, x right, y up, which replace those of the
            heights; None: those of the heights.
    """

    height: np.ndarray
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray | None = None
    normal: np.ndarray | None = None

    @property
    def aspect(self) -> float:
        """Height of the texture, in texture widths."""
        return self.height.shape[0] / self.height.shape[1]

    def unlike(self) -> list[str]:
        """A line for each map of another size than the height map."""
        rows, columns = self.height.shape
        others = {
            "albedo": self.albedo,
            "roughness": self.roughness,
            "metallic": self.metallic,
            "normal": self.normal,
        }
        return [
            f"warning: the {role} map is {picture.shape[1]} x {picture.shape[0]}, the height map "
            f"{columns} x {rows}: they are resized to one another"
            for role, picture in others.items()
            if picture is not None and picture.shape[:2] != (rows, columns)
        ]

    def reduced(self, width: int) -> TextureMaps:
        """The maps with at most `width` columns each, averaged where they had more."""
        normal = None if self.normal is None else unit(reduce(self.normal, width))
        return replace(
            self,
            height=reduce(self.height, width),
            albedo=reduce(self.albedo, width),
            roughness=reduce(self.roughness, width),
            metallic=None if self.metallic is None else reduce(self.metallic, width),
            normal=normal,
        )

    def normal_is_upside_down(self) -> bool:
        """Whether the normal map contradicts the heights in y, as in DirectX style."""
        if self.normal is None:
            return False
        rows, columns = self.height.shape
        # Proportional to y of the normals of the heights.
        slope = np.roll(self.height, -1, axis=0) - np.roll(self.height, 1, axis=0)
        tilt = resize(self.normal[..., 1], rows, columns)
        spread = float(slope.std() * tilt.std())
        return spread > 0.0 and float(np.mean(slope * (tilt - tilt.mean()))) < UPSIDE_DOWN * spread


def read_maps(
    *,
    height: Path | str,
    albedo: Path | str,
    roughness: Path | str,
    metallic: Path | str | None = None,
    normal: Path | str | None = None,
) -> TextureMaps:
    """Reads maps from picture files: albedo in sRGB, all others linear; alpha is ignored.

    Normal maps are in OpenGL style: red grows to the right, green upwards, blue outwards.

    Raises:
        DataError: a file is missing, no picture, of an unusable mode, or of another aspect.
    """
    maps = TextureMaps(
        height=read_grey(height, "height"),
        albedo=read_albedo(albedo, "albedo"),
        roughness=read_grey(roughness, "roughness"),
        metallic=None if metallic is None else read_grey(metallic, "metallic"),
        normal=None if normal is None else read_normal(normal, "normal"),
    )
    for role, picture, path in (
        ("albedo", maps.albedo, albedo),
        ("roughness", maps.roughness, roughness),
        ("metallic", maps.metallic, metallic),
        ("normal", maps.normal, normal),
    ):
        if picture is not None:
            _check_shape(picture, maps.height, role, path, height)
    return maps


def _check_shape(
    picture: np.ndarray,
    height: np.ndarray,
    role: str,
    path: Path | str | None,
    height_path: Path | str,
) -> None:
    """Refuses a map `[h, w, ...]` whose aspect is not that of the height map."""
    (rows, columns), (height_rows, height_columns) = picture.shape[:2], height.shape
    ratio = (rows * height_columns) / (columns * height_rows)
    if abs(ratio - 1.0) > SHAPE_TOLERANCE:
        raise DataError(
            f"{role} map {path} is {columns} x {rows} but height map {height_path} is "
            f"{height_columns} x {height_rows}; expected maps of one texture, so of one shape; "
            f"crop or rescale one of them."
        )


def read_grey(path: Path | str, role: str) -> np.ndarray:
    """A grey map `[h, w]` in [0, 1] from a picture of 8 or 16 bits or floats.

    Args:
        path: picture file.
        role: name of the map in messages.

    Raises:
        DataError: the file is no picture, coloured, or out of range.
    """
    values = _read(path, role)  # [h, w, 3]
    if float(np.ptp(values, axis=-1).mean()) > MAX_TINT:
        raise DataError(
            f"{role} map {path} is coloured; expected one grey value for each pixel; "
            f"if it packs several maps into its channels, save the right one alone."
        )
    return values.mean(axis=-1, dtype=np.float64).astype(np.float32)


def read_albedo(path: Path | str, role: str) -> np.ndarray:
    """A linear colour map `[h, w, 3]` from a picture in sRGB [IEC 61966-2-1].

    Args:
        path: picture file.
        role: name of the map in messages.

    Raises:
        DataError: the file is no picture, or of floats.
    """
    codes = _read(path, role, encoded=True)
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def read_normal(path: Path | str, role: str) -> np.ndarray:
    """Unit normals `[h, w, 3]` from a picture whose values 0 to 1 stand for -1 to 1.

    Args:
        path: picture file.
        role: name of the map in messages.

    Raises:
        DataError: the file is no picture, or of floats.
    """
    return unit(_read(path, role, encoded=True) * 2.0 - 1.0)


def _read(path: Path | str, role: str, encoded: bool = False) -> np.ndarray:
    """The values `[h, w, 3]` float32 of the picture of a map, black 0 and white 1."""
    if not Path(path).exists():
        raise DataError(
            f"{role} map {path} does not exist; expected a picture file; check the path."
        )
    try:
        values = read_picture(path, ignore_alpha=True, encoded=encoded)
    except DECODE_ERRORS as error:
        raise DataError(
            f"{role} map {path} cannot be read ({error}); expected a PNG, JPEG or TIFF picture; "
            f"save it again."
        ) from error
    if not (values.min() >= 0.0 and values.max() <= 1.0):  # also refuses NaN
        raise DataError(
            f"{role} map {path} has values from {values.min():g} to {values.max():g}; expected 0 "
            f"to 1; rescale it."
        )
    return values


def unit(normals: np.ndarray) -> np.ndarray:
    """Vectors `[..., 3]` with z of at least MIN_NORMAL_Z, then normalized, float32."""
    lifted = normals.astype(np.float32, copy=True)
    lifted[..., 2] = np.maximum(lifted[..., 2], MIN_NORMAL_Z)
    return lifted / np.linalg.norm(lifted, axis=-1, keepdims=True)


def reduce(picture: np.ndarray, width: int) -> np.ndarray:
    """A picture `[h, w, ...]` with at most `width` columns, averaged if it had more."""
    rows, columns = picture.shape[:2]
    if columns <= width:
        return picture
    return resize(picture, max(round(rows * width / columns), 1), width)


def resize(picture: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """A float picture `[h, w, ...]` resized by area if it gets narrower, else bilinearly."""
    if picture.shape[:2] == (rows, columns):
        return picture
    filter = Image.Resampling.BOX if columns < picture.shape[1] else Image.Resampling.BILINEAR
    layers = picture.reshape(*picture.shape[:2], -1)
    resized = [
        np.asarray(Image.fromarray(layer).resize((columns, rows), filter))
        for layer in np.ascontiguousarray(np.moveaxis(layers, -1, 0), dtype=np.float32)
    ]
    return np.stack(resized, axis=-1).reshape(rows, columns, *picture.shape[2:])
