"""Physics and orientation of path-traced pictures, against closed forms and symmetries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from spmm_torch.config.synthesis import FAST, PLAIN, SynthesisSettings
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize.maps import TextureMaps
from spmm_torch.synthesize.tracer import PathTracer, stratify
from spmm_torch.synthesize.variant import load_mitsuba, works

pytest.importorskip("mitsuba", reason="needs Mitsuba: pip install 'spmm_torch[mitsuba]'")

LOWEST_COSINE = float(np.cos(np.radians(75.0)))
Picture = Callable[..., np.ndarray]


def direction(theta: float, phi: float = 0.0) -> np.ndarray:
    """A unit vector of angles in degrees."""
    polar, azimuth = np.radians((theta, phi))
    return np.array(
        (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar))
    )


def texture(
    height: np.ndarray | None = None,
    albedo: np.ndarray | float = 1.0,
    roughness: float = 0.5,
    metallic: float | None = None,
    normal: np.ndarray | None = None,
) -> TextureMaps:
    """Maps that are uniform where nothing else is given; 8 x 8 if nothing tells the size."""
    height = np.zeros((8, 8), np.float32) if height is None else height.astype(np.float32)
    ones = np.ones_like(height)
    colour = np.broadcast_to(np.asarray(albedo, np.float32), (*height.shape, 3))
    metal = None if metallic is None else metallic * ones
    return TextureMaps(height, colour, roughness * ones, metal, normal)


def tracer(maps: TextureMaps, **changes: Any) -> Picture:
    """`tracer(maps, relief=0.1)(view, light)` is a picture `[H, W, 3]`; diffuse by default."""
    small = {"size": 8, "samples": 16, "specular": 0.0, "variant": PLAIN, "threads": 1}
    settings = SynthesisSettings(**(small | changes))
    mitsuba = load_mitsuba(settings.variant, settings.threads, Progress(enabled=False))
    made = PathTracer(mitsuba, maps, settings, LOWEST_COSINE)

    def picture(view: np.ndarray, light: np.ndarray, seed: int = 1) -> np.ndarray:
        return made.picture(made.camera(view), light, seed)

    return picture


def plateau(size: int, rows: slice, columns: slice) -> np.ndarray:
    """A height map `[size, size]` of one raised block."""
    height = np.zeros((size, size), np.float32)
    height[rows, columns] = 1.0
    return height


def waves(size: int) -> np.ndarray:
    """A periodic height map `[size, size]` without any symmetry."""
    y, x = np.mgrid[:size, :size] * (2.0 * np.pi / size)
    height = np.sin(x) + np.sin(x + 2.0 * y) + 0.5 * np.cos(2.0 * x - y + 1.0)
    return (height - height.min()) / np.ptp(height)


def burley_diffuse(wi: np.ndarray, wo: np.ndarray, roughness: float) -> float:
    """f_r of the diffuse part of `principled` at albedo 1 [Burley 2012, 2015]."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    retro = 2.0 * roughness * (half @ wi) ** 2
    at_light, at_view = (1.0 - wi[2]) ** 5, (1.0 - wo[2]) ** 5
    base = (1.0 - 0.5 * at_light) * (1.0 - 0.5 * at_view)
    both = retro * (at_light + at_view + at_light * at_view * (retro - 1.0))
    return float((base + both) / np.pi)


@pytest.mark.parametrize("theta_view", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("theta_light", [0.0, 45.0, 75.0])
def test_a_white_plane_reflects_its_brdf_times_the_cosine(
    theta_view: float, theta_light: float
) -> None:
    view, light = direction(theta_view, 20.0), direction(theta_light, 130.0)
    picture = tracer(texture(roughness=0.3))(view, light)
    expected = burley_diffuse(light, view, 0.3) * light[2]
    np.testing.assert_allclose(picture, expected, rtol=2e-3)  # Mitsuba's own Fresnel rounding


def test_a_white_plane_gives_the_cosine_over_pi() -> None:
    picture = tracer(texture())
    for theta in (0.0, 15.0, 30.0):
        light = direction(theta, 70.0)
        np.testing.assert_allclose(picture(direction(10.0), light), light[2] / np.pi, rtol=5e-3)


def test_colours_lie_where_the_map_has_them() -> None:
    # Row 0 is the top. A flat texture shows no parallax, however oblique the view.
    albedo = np.random.default_rng(0).random((4, 8, 3))  # a colour for each texel
    maps = texture(np.zeros((16, 32)), np.kron(albedo, np.ones((4, 4, 1))))
    picture = tracer(maps, samples=64)
    for view in (direction(0.0), direction(70.0, 25.0), direction(70.0, 250.0)):
        seen = picture(view, direction(0.0)) / burley_diffuse(direction(0.0), view, 0.5)
        np.testing.assert_allclose(seen, albedo, atol=0.12)  # interpolated at the borders


@pytest.mark.parametrize(("azimuth", "dark"), [(0, "left"), (90, "low"), (180, "right")])
def test_shadows_fall_away_from_the_light(azimuth: int, dark: str) -> None:
    # The block covers the four texels in the middle; tan(60) * 0.1 reaches more than one texel.
    height = plateau(32, slice(12, 20), slice(12, 20))
    picture = tracer(texture(height), relief=0.1, bounces=1)(
        direction(0.0), direction(60.0, azimuth)
    )[..., 0]
    beside = {
        "left": picture[3:5, 2],
        "right": picture[3:5, 5],
        "top": picture[2, 3:5],
        "low": picture[5, 3:5],
    }
    lit = picture[0, 0]
    assert (beside[dark] < 0.2 * lit).all()
    opposite = {"left": "right", "low": "top", "right": "left"}[dark]
    assert (beside[opposite] > 0.7 * lit).all()


@pytest.mark.parametrize("azimuth", [0.0, 90.0, 200.0])
def test_heights_move_against_the_view(azimuth: float) -> None:
    # A red spot on a plateau above black ground: p = q - h wo_xy / wo_z.
    relief = 0.15
    height = plateau(64, slice(24, 40), slice(24, 40))
    albedo = np.zeros((64, 64, 3))
    albedo[28:36, 28:36, 0] = 1.0
    picture = tracer(texture(height, albedo), relief=relief, size=32, bounces=1, samples=4)
    view = direction(50.0, azimuth)
    places = []
    for chosen in (direction(0.0), view):
        weight = picture(chosen, direction(0.0))[..., 0]
        row, column = np.mgrid[:32, :32]
        share = weight / weight.sum()
        places.append(((share * (column + 0.5)).sum() / 32, 1 - (share * (row + 0.5)).sum() / 32))
    moved = np.subtract(places[1], places[0])
    above = relief * (1.0 - height.mean())
    np.testing.assert_allclose(moved, -above * view[:2] / view[2], atol=0.01)


def test_the_texture_is_periodic() -> None:
    # Rolling all maps rolls the pictures: at grazing angles, parallax, shadows and light that
    # bounces cross the border.
    height = waves(16)
    albedo = np.random.default_rng(0).random((16, 16, 3))
    view, light = direction(70.0, 10.0), direction(70.0, 100.0)
    pictures = [
        tracer(texture(*maps), size=4, samples=1024, relief=0.15)(view, light)
        for maps in ((height, albedo), (np.roll(height, 8, 1), np.roll(albedo, 8, 1)))
    ]
    np.testing.assert_allclose(
        np.roll(pictures[0], 2, 1), pictures[1], atol=0.06 * pictures[0].max()
    )


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_the_mean_over_the_texture_is_reciprocal(metallic: float) -> None:
    # The whole relief is one rough surface; its BRDF holds shadows, masking and inter-reflection.
    maps = texture(waves(16), 0.8, roughness=0.7, metallic=metallic)
    picture = tracer(maps, size=4, samples=1024, relief=0.2, specular=0.5)
    first, second = direction(65.0, 20.0), direction(30.0, 250.0)
    there = picture(first, second).mean() / second[2]
    back = picture(second, first).mean() / first[2]
    assert there == pytest.approx(back, rel=0.03)


def test_light_that_bounces_brightens_a_groove() -> None:
    groove = np.repeat(np.abs(np.linspace(-1.0, 1.0, 16, endpoint=False))[None], 16, axis=0)
    means = [
        tracer(texture(groove, albedo), relief=0.5, bounces=bounces, samples=64)(
            direction(0.0), direction(0.0)
        ).mean()
        for albedo, bounces in ((0.9, 1), (0.9, 2), (0.9, 5))
    ]
    assert means[1] > 1.1 * means[0]
    assert means[2] > 1.02 * means[1]


def test_a_normal_map_tilts_the_shading() -> None:
    # Normals tilted towards +x by 30 degrees see a light from there face on.
    normal = np.broadcast_to(direction(30.0, 0.0), (8, 8, 3)).astype(np.float32)
    picture = tracer(texture(normal=normal))
    facing = picture(direction(30.0), direction(30.0)).mean()
    assert facing == pytest.approx(1.0 / np.pi, rel=1e-2)
    assert picture(direction(0.0), direction(30.0, 180.0)).mean() < 0.6 * facing


@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_metal_mirrors_and_has_no_diffuse_part(specular: float) -> None:
    picture = tracer(texture(roughness=0.2, metallic=1.0), specular=specular)
    mirror = picture(direction(40.0, 180.0), direction(40.0)).mean()
    assert mirror > 10.0
    assert picture(direction(40.0), direction(40.0)).mean() < 1e-3 * mirror


def test_the_same_seed_gives_the_same_bytes_for_any_number_of_threads() -> None:
    maps = texture(waves(16), 0.8)
    view, light = direction(60.0, 20.0), direction(45.0, 200.0)
    one = tracer(maps, relief=0.2, size=12)
    first, other = one(view, light, seed=7), one(view, light, seed=8)
    two = tracer(maps, relief=0.2, size=12, threads=2)
    np.testing.assert_array_equal(two(view, light, seed=7), first)
    assert (other != first).any()
    np.testing.assert_allclose(other.mean(), first.mean(), rtol=0.05)


def test_both_variants_agree() -> None:
    if not works(FAST):
        pytest.skip(f"{FAST} does not work here: it needs libLLVM 19 or newer")
    maps = texture(waves(32), 0.8, roughness=0.4)
    view, light = direction(60.0, 20.0), direction(45.0, 200.0)
    pictures = []
    for variant in (PLAIN, FAST):
        picture = tracer(maps, relief=0.1, samples=1024, specular=0.5, variant=variant)
        pictures.append(picture(view, light))
        np.testing.assert_array_equal(picture(view, light), pictures[-1])
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=0.1)
    assert pictures[0].mean() == pytest.approx(pictures[1].mean(), rel=0.005)


@pytest.mark.parametrize(
    ("samples", "strata"), [(1, (1, 1)), (7, (7, 1)), (16, (4, 4)), (24, (6, 4))]
)
def test_strata_are_as_square_as_can_be(samples: int, strata: tuple[int, int]) -> None:
    assert stratify(samples) == strata
