"""Lookups of areas: levels are mixed by the logarithm of the size, and each is fit to means."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM, DataError, OutputError
from spmm_torch.geometry.warp import square_to_uniform_hemisphere
from spmm_torch.model.pyramid import Pyramid
from tests.planted.directions import random_directions
from tests.planted.models import planted_model

WIDTH = 8


@pytest.fixture(scope="module")
def levels() -> list[SPMM]:
    return [planted_model(size, seed=size) for size in (WIDTH, 4, 2)]


def queries(count: int) -> tuple[Tensor, Tensor, Tensor]:
    uv = torch.rand(count, 2, generator=torch.Generator().manual_seed(1))
    wi, wo = (random_directions(count, seed, 1.2, torch.float32) for seed in (2, 3))
    return uv, wi, wo


@pytest.mark.parametrize(
    ("texels", "level"), [(0.0, 0), (0.3, 0), (1.0, 0), (2.0, 1), (4.0, 2), (99.0, 2)]
)
def test_sizes_of_texels_show_one_level(levels: list[SPMM], texels: float, level: int) -> None:
    given = queries(9)
    found = Pyramid(levels)(*given, torch.tensor(texels / WIDTH))
    torch.testing.assert_close(found, levels[level](*given))


def test_between_levels_values_are_mixed(levels: list[SPMM]) -> None:
    given, pyramid = queries(6), Pyramid(levels)
    footprint = torch.tensor([1.0, 2**0.25, 2**0.5, 2**1.5, 3.0, 4.0]) / WIDTH
    first, second, third = (level(*given) for level in levels)
    share = torch.log2(footprint * WIDTH)[:, None]
    expected = torch.where(
        share < 1.0, torch.lerp(first, second, share), torch.lerp(second, third, share - 1.0)
    )
    torch.testing.assert_close(pyramid(*given, footprint), expected)
    transformed = torch.func.vmap(pyramid)(*given, footprint)
    torch.testing.assert_close(transformed, expected, rtol=1e-4, atol=1e-6)


def test_samples_weigh_the_light_of_an_area(levels: list[SPMM]) -> None:
    """The mean of value / density is the integral of values, and the density integrates to 1."""
    pyramid, footprint = Pyramid(levels), torch.tensor(2**0.4 / WIDTH)
    uv, wo = torch.tensor([0.3, 0.6]), torch.tensor([0.48, 0.0, 0.8773825])
    u = torch.quasirandom.SobolEngine(3).draw(1 << 14)
    even = square_to_uniform_hemisphere(u[:, :2])
    values = pyramid(uv, even, wo, footprint).mean(dim=0) * (2.0 * torch.pi)
    total = pyramid.pdf(uv, even, wo, footprint).mean() * (2.0 * torch.pi)
    torch.testing.assert_close(total, torch.tensor(1.0), rtol=5e-3, atol=0.0)
    wi, value, density = pyramid.sample(uv, wo, u, footprint)
    torch.testing.assert_close((value / density[:, None]).mean(dim=0), values, rtol=1e-2, atol=0.0)
    assert pyramid.sample(uv, wo, u[:0], footprint)[0].shape == (0, 3)


def test_shapes_gradients_and_nothing(levels: list[SPMM]) -> None:
    pyramid = Pyramid(levels)
    uv, wi, wo = queries(4)
    footprint = torch.full((3, 4), 0.2, requires_grad=True)
    value = pyramid(uv, wi, wo, footprint)
    assert value.shape == (3, 4, 3)
    value.sum().backward()
    assert footprint.grad is not None and footprint.grad.abs().sum() > 0.0
    assert pyramid(uv[:0], wi[:0], wo[:0], torch.tensor(0.2)).shape == (0, 3)


@pytest.mark.parametrize("side", [float("nan"), -0.1])
def test_sides_that_are_none_are_refused(levels: list[SPMM], side: float) -> None:
    pyramid, (uv, wi, wo) = Pyramid(levels), queries(3)
    footprint = torch.tensor([0.1, 0.2, side])
    u = torch.full((3, 3), 0.5)
    for ask in (pyramid, pyramid.pdf):
        with pytest.raises(DataError, match=r"^footprint of query 2 is \(.*from 0; mend"):
            ask(uv, wi, wo, footprint)
    with pytest.raises(DataError, match=r"^footprint of query 2 is"):
        pyramid.sample(uv, wo, u, footprint)
    with pytest.raises(DataError, match=r"^wi of query 2 is"):
        pyramid(uv, wi * torch.tensor([[1.0], [1.0], [2.0]]), wo, torch.tensor(0.1))
    with pytest.raises(DataError, match=r"footprint of \(2,\), .*; expected shapes that broadcast"):
        pyramid(uv, wi, wo, footprint[:2])


def test_round_trip(levels: list[SPMM], tmp_path: Path) -> None:
    Pyramid(levels).save(tmp_path / "wool")
    given = (*queries(5), torch.tensor(0.3))
    torch.testing.assert_close(Pyramid.load(tmp_path / "wool")(*given), Pyramid(levels)(*given))
    with pytest.raises(OutputError, match="holds no level0.safetensors"):
        Pyramid.load(tmp_path)


def test_a_folder_that_cannot_be_made_ends_in_a_sentence(
    levels: list[SPMM], tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    for place in (tmp_path / "file", tmp_path / "file" / "wool"):
        with pytest.raises(OutputError, match=f"^{place} cannot be written .*; choose"):
            Pyramid(levels).save(place)


def test_no_level_is_refused() -> None:
    with pytest.raises(ValueError, match="without levels"):
        Pyramid([])


def test_more_than_ten_levels_keep_their_order(tmp_path: Path) -> None:
    models = [planted_model(1, seed=seed) for seed in range(12)]
    Pyramid(models).save(tmp_path)
    for level, model in zip(Pyramid.load(tmp_path).levels, models, strict=True):
        assert isinstance(level, SPMM)
        assert torch.equal(level.weight, model.weight)
