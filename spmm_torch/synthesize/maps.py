"""Texture maps: read, checked against each other, and reduced to the detail worth tracing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from ..errors import DataError

# Code of white by mode of a grey picture; floats are taken as they are.
WHITE = {"L": 255, "I;16": 65535, "I;16B": 65535, "I;16L": 65535, "I": 65535, "F": 1}
# Modes that Pillow turns into 8-bit grey or RGB without losing anything but transparency.
PLAIN = {"1": "L", "LA": "L", "P": "RGB", "PA": "RGB", "RGBA": "RGB", "RGBX": "RGB"}
DECODE_ERRORS = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)
# Grey saved as colour differs between channels by JPEG's rounding only: mean of 8-bit codes.
MAX_TINT = 4.0
# Maps of one texture may differ in size; a rounded side must not count as another shape.
SHAPE_TOLERANCE = 0.01
# Normals of maps are kept this far above the plane, so that each has a front side.
MIN_NORMAL_Z = 0.05
# Normals of a map that is upside down correlate with those of the heights by about -1.
UPSIDE_DOWN = -0.2


@dataclass(frozen=True, eq=False)
class TextureMaps:
    """The maps of one periodic texture; row 0 is the top, sizes may differ, shapes do not.

    Args:
        height: `[h, w]` in [0, 1].
        albedo: linear base colour `[h, w, 3]` in [0, 1].
        roughness: `[h, w]` in [0, 1]; its square is the width of the microfacet distribution.
        metallic: `[h, w]` in [0, 1]; None = no metal.
        normal: unit shading normals `[h, w, 3]`, x right, y up, in place of those of the heights
            (not on top of them); None = those of the heights.
    """

    height: np.ndarray
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray | None = None
    normal: np.ndarray | None = None

    @property
    def aspect(self) -> float:
        """Height of the texture in texture widths."""
        return self.height.shape[0] / self.height.shape[1]

    def reduced(self, width: int) -> TextureMaps:
        """The same maps, averaged down where they are more than `width` samples wide."""
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
        """Whether the green channel of the normal map contradicts the heights (DirectX style)."""
        if self.normal is None:
            return False
        rows, columns = self.height.shape
        slope = np.roll(self.height, -1, axis=0) - np.roll(self.height, 1, axis=0)  # normal's y
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
    """Reads maps: albedo is decoded from sRGB, all others are linear; alpha is ignored.

    Normal maps are in OpenGL style: red grows to the right, green up, blue out.

    Raises:
        DataError: a file is missing, no picture, of an unusable mode, or of another shape.
    """
    readers: dict[str, tuple[Path | str | None, Callable[[Path | str, str], np.ndarray]]] = {
        "height": (height, read_grey),
        "albedo": (albedo, read_albedo),
        "roughness": (roughness, read_grey),
        "metallic": (metallic, read_grey),
        "normal": (normal, read_normal),
    }
    maps = {
        role: None if path is None else read(path, role) for role, (path, read) in readers.items()
    }
    for role, picture in maps.items():
        _check_shape(picture, maps["height"], role, readers[role][0], height)
    return TextureMaps(**maps)


def _check_shape(
    picture: np.ndarray | None,
    height: np.ndarray,
    role: str,
    path: Path | str | None,
    height_path: Path | str,
) -> None:
    if picture is None:
        return
    (rows, columns), (height_rows, height_columns) = picture.shape[:2], height.shape
    ratio = (rows * height_columns) / (columns * height_rows)
    if abs(ratio - 1.0) > SHAPE_TOLERANCE:
        raise DataError(
            f"{role} map {path} is {columns} x {rows} but height map {height_path} is "
            f"{height_columns} x {height_rows}; expected maps of one texture, so of one shape; "
            f"crop or rescale one of them."
        )


def read_grey(path: Path | str, role: str) -> np.ndarray:
    """A map `[h, w]` of one value, 8-bit, 16-bit or float, scaled to [0, 1].

    Raises:
        DataError: no picture, coloured, or out of range.
    """
    image = _open(path, role)
    if image.mode == "RGB":
        codes = np.asarray(image, dtype=np.float32)  # [h, w, 3]
        if float(np.ptp(codes, axis=-1).mean()) > MAX_TINT:
            raise DataError(
                f"{role} map {path} is coloured; expected one grey value for each pixel; "
                f"if it packs several maps into its channels, save the right one alone."
            )
        return codes.mean(axis=-1) / 255.0
    if image.mode not in WHITE:
        raise _wrong_mode(path, role, image, "grey of 8 or 16 bits or float")
    values = np.asarray(image, dtype=np.float32) / WHITE[image.mode]
    if not (values.min() >= 0.0 and values.max() <= 1.0):  # also refuses NaN
        raise DataError(
            f"{role} map {path} has values from {values.min():g} to {values.max():g}; expected 0 "
            f"to 1; rescale it."
        )
    return values


def read_albedo(path: Path | str, role: str) -> np.ndarray:
    """A colour map `[h, w, 3]`, decoded from sRGB [IEC 61966-2-1] to linear values."""
    codes = _read_rgb(path, role) / 255.0
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def read_normal(path: Path | str, role: str) -> np.ndarray:
    """Unit normals `[h, w, 3]` of a map whose codes 0 to 255 stand for -1 to 1."""
    return unit(_read_rgb(path, role) / 127.5 - 1.0)


def _read_rgb(path: Path | str, role: str) -> np.ndarray:
    image = _open(path, role)
    if image.mode not in ("RGB", "L"):
        raise _wrong_mode(path, role, image, "8-bit RGB")
    return np.asarray(image.convert("RGB"), dtype=np.float32)  # [h, w, 3]


def _open(path: Path | str, role: str) -> Image.Image:
    if not Path(path).exists():
        raise DataError(
            f"{role} map {path} does not exist; expected a picture file; check the path."
        )
    try:
        with Image.open(path) as image:
            image.load()
            return image.convert(PLAIN[image.mode]) if image.mode in PLAIN else image.copy()
    except DECODE_ERRORS as error:
        raise DataError(
            f"{role} map {path} cannot be read ({error}); expected a PNG, JPEG or TIFF picture; "
            f"save it anew."
        ) from error


def _wrong_mode(path: Path | str, role: str, image: Image.Image, expected: str) -> DataError:
    return DataError(f"{role} map {path} has mode {image.mode}; expected {expected}; convert it.")


def unit(normals: np.ndarray) -> np.ndarray:
    """Vectors `[..., 3]` lifted above the plane and scaled to length 1, float32."""
    lifted = normals.astype(np.float32, copy=True)
    lifted[..., 2] = np.maximum(lifted[..., 2], MIN_NORMAL_Z)
    return lifted / np.linalg.norm(lifted, axis=-1, keepdims=True)


def reduce(picture: np.ndarray, width: int) -> np.ndarray:
    """A picture `[h, w, ...]` averaged down to `width` columns, or as it is if not wider."""
    rows, columns = picture.shape[:2]
    if columns <= width:
        return picture
    return resize(picture, max(round(rows * width / columns), 1), width)


def resize(picture: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """A float picture `[h, w, ...]` at another size, by area if smaller, else bilinear."""
    if picture.shape[:2] == (rows, columns):
        return picture
    filter = Image.Resampling.BOX if columns < picture.shape[1] else Image.Resampling.BILINEAR
    layers = picture.reshape(*picture.shape[:2], -1)
    resized = [
        np.asarray(Image.fromarray(layer).resize((columns, rows), filter))
        for layer in np.ascontiguousarray(np.moveaxis(layers, -1, 0), dtype=np.float32)
    ]
    return np.stack(resized, axis=-1).reshape(rows, columns, *picture.shape[2:])
