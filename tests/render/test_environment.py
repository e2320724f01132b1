"""Environment lights: axes, densities, files, and the estimator against brute force."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from scipy import stats
from torch import Tensor

from spmm_torch.data.codecs import openexr, radiance
from spmm_torch.errors import DataError
from spmm_torch.geometry.warp import square_to_uniform_hemisphere
from spmm_torch.render import CosineSampled, EnvironmentLight, SampledMaterial, turn
from spmm_torch.render.direct import from_environment, lit_values
from spmm_torch.render.material import with_sampler
from tests.planted.materials import Lambertian, Shiny, hits_of

SIGNIFICANCE = 0.01


def spotted(height: int = 6, width: int = 12) -> Tensor:
    """A dim map with a bright spot, a black row and black pixels."""
    picture = 0.2 * torch.rand(height, width, 3, generator=torch.Generator().manual_seed(0))
    picture[2, 5] = torch.tensor([9.0, 6.0, 3.0])
    picture[1] = 0.0
    picture[3, -3:] = 0.0
    picture[-1, -1] = 0.0
    return picture


@pytest.mark.parametrize(
    ("direction", "row", "column"),
    [
        ((0, 1, 0), 0, None),
        ((0, -1, 0), 3, None),
        ((0, 0.01, 1), 1, 4),
        ((1, 0.01, 0), 1, 2),
        ((-1, -0.01, 0), 2, 6),
    ],
)
def test_axes_are_those_of_openexr(direction: tuple, row: int, column: int | None) -> None:
    number = torch.arange(4 * 8).float().view(4, 8, 1).expand(4, 8, 3) + 1.0
    light = EnvironmentLight.build(number)
    w = torch.tensor(direction, dtype=torch.float32)
    w = w + torch.tensor([1e-4, 0.0, -1e-4])  # off the edges between pixels
    pixel = int(light.radiance(w / w.norm())[0]) - 1
    assert pixel // 8 == row
    assert column is None or pixel % 8 in (column - 1, column)


def test_density_is_normalized_and_is_that_of_the_samples() -> None:
    light = EnvironmentLight.build(spotted()).rotated(turn((0.6, 0.8, 0.0), 1.0))
    u = torch.rand(200_000, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    direction, value, pdf = light.sample(u)
    assert bool((pdf > 0.0).all())
    torch.testing.assert_close(direction.norm(dim=1), torch.ones_like(pdf))
    same = (light.pdf(direction) == pdf) & (light.radiance(direction) == value).all(1)
    assert float(same.float().mean()) > 0.9999  # all but those on an edge of a pixel
    # Uniform directions integrate the density to 1; samples are as frequent as it says.
    w = torch.randn(200_000, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    w = w / w.norm(dim=1, keepdim=True)
    mass = 4.0 * math.pi * light.pdf(w)
    assert abs(float(mass.mean()) - 1.0) < 4.0 * float(mass.std()) / math.sqrt(len(mass))
    edges = torch.cos(torch.linspace(0, math.pi, 7, dtype=torch.float64))
    area = ((edges[:-1] - edges[1:]) * (2.0 * math.pi / 12))[:, None].expand(6, 12).flatten()
    expected = light.density * area
    torch.testing.assert_close(expected.sum(), torch.ones((), dtype=torch.float64))
    counts = torch.bincount(light._pixel(direction), minlength=72)
    used = expected > 0.0
    assert stats.chisquare(counts[used], 200_000 * expected[used]).pvalue > SIGNIFICANCE


def test_samples_are_even_within_a_pixel() -> None:
    light = EnvironmentLight.build(torch.ones(1, 1, 3))
    u = torch.rand(50_000, 2, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    w, _, pdf = light.sample(u)
    torch.testing.assert_close(pdf, torch.full_like(pdf, 1.0 / (4.0 * math.pi)))
    for axis in range(3):
        assert stats.kstest(w[:, axis], stats.uniform(-1.0, 2.0).cdf).pvalue > SIGNIFICANCE / 3


@pytest.mark.parametrize("material", [Shiny(), CosineSampled(Shiny()), CosineSampled(Lambertian())])
def test_estimates_agree_with_brute_force(material: SampledMaterial) -> None:
    hits, count = hits_of(8, 4), 40_000
    tilt = turn((0.0, 0.6, 0.8), 2.0)
    light = EnvironmentLight.build(spotted()).rotated(tilt)
    generator = torch.Generator().manual_seed(5)
    wi = square_to_uniform_hemisphere(torch.rand(8, 10 * count, 2, generator=generator))
    brute = 2.0 * math.pi * lit_values(material, hits, wi) * light.radiance(wi)
    expected, spread = brute.mean(1), brute.std(1) / math.sqrt(10 * count)
    parts = []
    for _ in range(count // 100):
        u = torch.rand(8, 100, 5, generator=generator)
        parts.append(from_environment(material, hits, light, (u[..., :2], u[..., 2:])))
    estimate = torch.stack(parts)
    error = torch.sqrt(estimate.var(0) / len(parts) + spread**2)
    limit = stats.norm.isf((1.0 - (1.0 - SIGNIFICANCE) ** (1 / error.numel())) / 2.0)
    assert float(((estimate.mean(0) - expected) / error).abs().max()) < limit


@pytest.mark.parametrize("bright", ["a point", "a half"])
def test_both_kinds_of_samples_are_as_good_as_the_better_one(bright: str) -> None:
    picture = torch.full((32, 64, 3), 0.01)
    if bright == "a point":  # which the material misses
        picture[12, 32] = 1000.0
    else:  # where the light misses the highlight
        picture[:20] = 1.0
    light = EnvironmentLight.build(picture).rotated(turn((1.0, 0.0, 0.0), 1.5))
    u = torch.rand(20_000, 1, 5, generator=torch.Generator().manual_seed(7))
    hits = hits_of(1, 6)[torch.zeros(len(u), dtype=torch.long)]
    joint = from_environment(Shiny(), hits, light, (u[..., :2], u[..., 2:]))
    wi, value, pdf = Shiny().sample(hits.uv, hits.wo, u[:, 0, 2:])
    by_material = value * light.radiance(wi) / pdf[:, None]
    wi, radiance, pdf = light.sample(u[:, 0, :2])
    by_light = lit_values(Shiny(), hits, wi[:, None])[:, 0] * radiance / pdf[:, None]
    alone = (float(by_material.var()), float(by_light.var()))
    assert float(joint.var()) < 1.5 * min(alone)
    assert float(joint.var()) < 0.1 * max(alone)


def test_a_material_with_a_sampler_keeps_it() -> None:
    assert isinstance(with_sampler(Lambertian()), CosineSampled)
    shiny = Shiny()
    assert with_sampler(shiny) is shiny


def tiff_of(picture: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, picture, photometric="rgb")
    return buffer.getvalue()


def test_files_are_read(tmp_path: Path) -> None:
    picture = spotted().numpy()
    codes = radiance.float_to_rgbe(picture)
    (tmp_path / "x.exr").write_bytes(openexr.encode(picture))
    (tmp_path / "x.hdr").write_bytes(radiance.encode(codes))
    (tmp_path / "x.tif").write_bytes(tiff_of(picture))
    exr, hdr, tif = (
        EnvironmentLight.read(tmp_path / f"x.{name}") for name in ("exr", "hdr", "tif")
    )
    assert np.array_equal(exr.picture.numpy(), picture)
    assert np.array_equal(tif.picture.numpy(), picture)
    assert np.array_equal(hdr.picture.numpy(), radiance.rgbe_to_float(codes))


def test_studio_lights_from_the_front_and_above() -> None:
    light = EnvironmentLight.studio()
    height, width, _ = light.picture.shape
    assert width == 2 * height
    brightest = light.sample(torch.full((1, 2), 0.5))[0][0]
    assert float(brightest[1]) > 0.0
    up, down = light.radiance(torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])).sum(1)
    assert float(up) > float(down) > 0.0


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"not a picture", "neither OpenEXR nor Radiance"),
        (tiff_of(np.ones((2, 4, 3), np.uint16)), "holds torch.uint16 codes of a display"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n", "x.exr cannot be read"),
        (openexr.encode(spotted().numpy())[:200], "x.exr cannot be read"),
        (openexr.encode(-spotted().numpy()), "holds negative radiance"),
        (openexr.encode(np.full((2, 4, 3), np.inf, np.float32)), "not finite"),
        (openexr.encode(np.zeros((2, 4, 3), np.float32)), "all black"),
    ],
)
def test_bad_maps(tmp_path: Path, content: bytes, complaint: str) -> None:
    (tmp_path / "x.exr").write_bytes(content)
    with pytest.raises(DataError, match=complaint):
        EnvironmentLight.read(tmp_path / "x.exr")


def test_missing_map(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        EnvironmentLight.read(tmp_path / "none.exr")


def test_bad_shape() -> None:
    with pytest.raises(DataError, match=r"shape \[4, 8\]"):
        EnvironmentLight.build(torch.ones(4, 8))
