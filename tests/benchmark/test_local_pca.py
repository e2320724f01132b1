"""Local PCA: exact where the rank is low, counted byte by byte, and drawn through a relief."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import BTF
from spmm_torch.benchmark.drawing import snr_of_pictures
from spmm_torch.benchmark.peers import local_pca
from spmm_torch.benchmark.peers.local_pca import LocalPCA
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.model.relief import Relief
from tests.planted.reliefs import PlantedRelief, planted_relief

TEXELS, VIEWS, LIGHTS, CHANNELS, RANK = 40, 5, 6, 3, 3
PAIRS = VIEWS * LIGHTS


@pytest.fixture
def values() -> torch.Tensor:
    """Values `[T, D, C]` of rank 3."""
    generator = torch.Generator().manual_seed(0)
    parts = (torch.rand(size, generator=generator) for size in ((TEXELS, RANK), (RANK, PAIRS * 3)))
    left, right = parts
    return (left @ right).view(TEXELS, PAIRS, CHANNELS)


def fitted(values: torch.Tensor, components: int) -> tuple[LocalPCA, torch.Tensor]:
    """Two clusters, and their values `[T, D, C]`."""
    found = local_pca.local_pca(values, torch.arange(TEXELS) % 2, components, VIEWS)
    return found, torch.cat([found.of_view(view) for view in range(VIEWS)], dim=1)


def test_it_is_exact_where_the_rank_is_low(values: torch.Tensor) -> None:
    found, near = fitted(values, RANK)
    # Half a step of a byte for each function, whose scale is that of its largest value.
    assert (near - values).abs().max() < 0.02 * values.max()
    _, worse = fitted(values, 1)
    assert (worse - values).norm() > 10.0 * (near - values).norm()
    assert found.texel_bytes == TEXELS * (RANK + 1)
    functions = 2 * (1 + RANK)
    assert found.shared_bytes == functions * (PAIRS * CHANNELS + 4 * VIEWS) + 4 * 2 * RANK


def test_first_components_are_a_smaller_fit(values: torch.Tensor) -> None:
    found, _ = fitted(values, RANK)
    fewer, _ = fitted(values, 1)
    assert found.first(1).texel_bytes == fewer.texel_bytes == 2 * TEXELS
    for view in range(VIEWS):
        assert found.first(1).of_view(view) == pytest.approx(fewer.of_view(view), abs=1e-4)


def test_no_components_are_means(values: torch.Tensor) -> None:
    found, near = fitted(values, 0)
    assert found.texel_bytes == TEXELS
    mean = values[::2].mean(0)
    assert near[0] == pytest.approx(mean, abs=0.01 * float(mean.max()))


def test_a_cluster_has_fewer_components_than_texels(values: torch.Tensor) -> None:
    found = local_pca.local_pca(values, torch.tensor([0] * 39 + [1]), 8, VIEWS)
    assert [len(piece.coefficient_scale) for piece in found.pieces] == [8, 0]
    assert found.of_view(0)[-1] == pytest.approx(values[-1, :LIGHTS], abs=0.01)


@pytest.fixture(scope="module")
def planted() -> PlantedRelief:
    views = ring_directions(((0.0, 1), (30.0, 5), (60.0, 8)))
    return planted_relief(0.015, 0.05, size=(24, 24), views=views)


def snr_of(btf: BTF, relief: Relief | None) -> float:
    values = local_pca.surface(btf, relief).texels()
    labels = torch.zeros(btf.texel_count, dtype=torch.long)
    found = local_pca.local_pca(values, labels, 4, len(btf.view))
    return snr_of_pictures(btf, local_pca.drawn(found, btf, relief))


def test_the_true_relief_pays(planted: PlantedRelief) -> None:
    relief = Relief.of_heights(planted.height.flatten())
    assert snr_of(planted.btf, relief) > snr_of(planted.btf, None) + 2.0


def test_bytes_of_a_relief() -> None:
    drift = torch.zeros(9, 2)
    heights = torch.linspace(0.0, 0.1, TEXELS)
    assert local_pca.relief_bytes(None, TEXELS) == (0, 0)
    assert local_pca.relief_bytes(Relief.of_heights(heights), TEXELS) == (TEXELS, 8)
    plane = Relief.of_heights(torch.full((TEXELS,), 0.1), drift=drift)
    assert local_pca.relief_bytes(plane, TEXELS) == (0, 8 + 4 * 18)
