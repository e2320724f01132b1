"""Reading texture maps: codes, shapes, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from spmm_torch.errors import DataError
from spmm_torch.synthesize.maps import (
    TextureMaps,
    read_albedo,
    read_grey,
    read_maps,
    read_normal,
    reduce,
    unit,
)

Save = Callable[..., Path]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    """Saves a picture: `save("a.png", array)` is its path."""

    def write(name: str, picture: np.ndarray) -> Path:
        Image.fromarray(picture).save(tmp_path / name)
        return tmp_path / name

    return write


def grey(rows: int, columns: int, code: int = 128) -> np.ndarray:
    return np.full((rows, columns), code, np.uint8)


@pytest.mark.parametrize(
    ("name", "picture"),
    [
        ("8.png", np.array([[0, 51], [102, 255]], np.uint8)),
        ("16.png", np.array([[0, 13107], [26214, 65535]], np.uint16)),
        ("16.tif", np.array([[0, 13107], [26214, 65535]], np.uint16)),
        ("float.tif", np.array([[0.0, 0.2], [0.4, 1.0]], np.float32)),
        ("rgb.png", np.repeat(np.array([[0, 51], [102, 255]], np.uint8)[..., None], 3, axis=2)),
    ],
)
def test_grey_maps_of_any_depth_are_read_as_0_to_1(
    save: Save, name: str, picture: np.ndarray
) -> None:
    values = read_grey(save(name, picture), "height")
    np.testing.assert_allclose(values, [[0.0, 0.2], [0.4, 1.0]], atol=1e-6)


def test_albedo_is_decoded_from_srgb(save: Save) -> None:
    # Published pairs of codes and linear values: the linear toe, middle grey and white.
    codes = np.array([[[0, 10, 188], [255, 128, 255]]], np.uint8)
    expected = [[[0.0, 0.003035, 0.502887], [1.0, 0.215861, 1.0]]]
    np.testing.assert_allclose(read_albedo(save("a.png", codes), "albedo"), expected, atol=1e-6)


def test_normals_are_decoded_and_scaled(save: Save) -> None:
    codes = np.array([[[128, 128, 255], [255, 128, 128], [128, 0, 128]]], np.uint8)
    normals = read_normal(save("n.png", codes), "normal")
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(normals[0, 0], (0.0, 0.0, 1.0), atol=0.005)
    np.testing.assert_allclose(normals[0, 1], (1.0, 0.0, 0.05), atol=0.005)
    np.testing.assert_allclose(normals[0, 2], (0.0, -1.0, 0.05), atol=0.005)


def test_transparency_is_ignored(save: Save) -> None:
    codes = np.zeros((2, 2, 4), np.uint8)
    codes[..., :3] = 255
    np.testing.assert_allclose(read_albedo(save("a.png", codes), "albedo"), 1.0)


def test_maps_of_one_shape_may_differ_in_size(save: Save) -> None:
    maps = read_maps(
        height=save("h.png", grey(20, 40)),
        albedo=save("a.png", np.zeros((10, 20, 3), np.uint8)),
        roughness=save("r.png", grey(40, 80)),
        metallic=save("m.png", grey(20, 40)),
    )
    assert maps.aspect == 0.5
    assert maps.albedo.shape == (10, 20, 3)
    assert maps.normal is None
    assert [line.split(",")[0] for line in maps.unlike()] == [
        "warning: the albedo map is 20 x 10",
        "warning: the roughness map is 80 x 40",
    ]


def test_maps_of_another_shape_are_refused(save: Save) -> None:
    height, albedo = save("h.png", grey(20, 40)), save("a.png", np.zeros((20, 20, 3), np.uint8))
    with pytest.raises(DataError, match=r"albedo map .*a.png is 20 x 20 but height map .* 40 x 20"):
        read_maps(height=height, albedo=albedo, roughness=height)


def write_text(folder: Path) -> Path:
    (folder / "x.png").write_text("not a picture")
    return folder / "x.png"


def write_half(folder: Path) -> Path:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64), np.uint8)).save(
        folder / "x.png"
    )
    payload = (folder / "x.png").read_bytes()
    (folder / "x.png").write_bytes(payload[: len(payload) // 2])
    return folder / "x.png"


def write_coloured(folder: Path) -> Path:
    codes = np.zeros((4, 4, 3), np.uint8)
    codes[..., 0] = 200
    Image.fromarray(codes).save(folder / "x.png")
    return folder / "x.png"


def write_large_values(folder: Path) -> Path:
    Image.fromarray(np.array([[0.0, 7.5]], np.float32)).save(folder / "x.tif")
    return folder / "x.tif"


def write_print_colours(folder: Path) -> Path:
    Image.new("CMYK", (4, 4)).save(folder / "x.jpg")
    return folder / "x.jpg"


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda folder: folder / "no.png", "roughness map .*no.png does not exist"),
        (lambda folder: folder, "cannot be read"),
        (write_text, "cannot be read"),
        (write_half, "cannot be read"),
        (write_coloured, "is coloured; expected one grey value"),
        (write_large_values, "has values from 0 to 7.5; expected 0 to 1"),
        (write_print_colours, "mode CMYK instead of RGB or grey"),
    ],
)
def test_what_is_no_grey_map_is_refused(
    tmp_path: Path, make: Callable[[Path], Path], complaint: str
) -> None:
    with pytest.raises(DataError, match=complaint):
        read_grey(make(tmp_path), "roughness")


def test_maps_of_16_bits_keep_what_8_bits_lose(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 250, (4, 5, 3), dtype=np.uint16)
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(codes))
    np.testing.assert_allclose(
        read_albedo(tmp_path / "a.png", "albedo"), codes / 65535 / 12.92, rtol=1e-5
    )
    codes[..., 2] = 65535
    (tmp_path / "n.png").write_bytes(imagecodecs.png_encode(codes))
    np.testing.assert_allclose(
        read_normal(tmp_path / "n.png", "normal"), unit(codes / 32767.5 - 1.0), rtol=1e-6
    )


@pytest.mark.parametrize("read", [read_albedo, read_normal])
def test_floats_are_neither_srgb_nor_coded_normals(save: Save, read: Callable) -> None:
    with pytest.raises(DataError, match="holds linear values; expected codes of 8 or 16 bits"):
        read(save("a.tif", np.zeros((4, 4), np.float32)), "map")


@pytest.mark.parametrize("width", [8, 12, 16, 40])
def test_reducing_keeps_the_mean_and_never_enlarges(width: int) -> None:
    picture = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    smaller = reduce(picture, width)
    assert smaller.shape == (min(width, 32), min(width, 32), 3)
    # Pillow counts whole pixels, which is exact where the width divides.
    np.testing.assert_allclose(smaller.mean((0, 1)), picture.mean((0, 1)), rtol=0.02)


def waves_and_their_normals() -> tuple[np.ndarray, np.ndarray]:
    """A height map `[32, 32]` and its normals `[32, 32, 3]` in OpenGL style (y up)."""
    y, x = -np.mgrid[:32, :32] * (2.0 * np.pi / 32.0)  # row 0 is the top
    height = 0.5 + 0.25 * (np.sin(x) + np.sin(x + 2.0 * y))
    slopes = (np.cos(x) + np.cos(x + 2.0 * y), 2.0 * np.cos(x + 2.0 * y))
    normal = unit(np.stack((slopes[0], -slopes[1], np.full_like(x, 4.0)), axis=-1))
    return height.astype(np.float32), normal


def test_a_normal_map_in_directx_style_is_noticed() -> None:
    height, normal = waves_and_their_normals()
    flipped = normal * np.array((1.0, -1.0, 1.0), np.float32)
    colour = np.ones((32, 32, 3), np.float32)
    assert not TextureMaps(height, colour, height, normal=normal).normal_is_upside_down()
    assert TextureMaps(height, colour, height, normal=flipped).normal_is_upside_down()
    assert not TextureMaps(height, colour, height).normal_is_upside_down()
    flat = np.zeros_like(height)
    assert not TextureMaps(flat, colour, flat, normal=normal).normal_is_upside_down()
