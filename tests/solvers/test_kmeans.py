"""k-means against scikit-learn, and data with fewer distinct points than clusters."""

from __future__ import annotations

import pytest
import torch
from sklearn.cluster import KMeans
from torch import Tensor

from spmm_torch.errors import ConfigError, DataError
from spmm_torch.solvers import kmeans as module
from spmm_torch.solvers.kmeans import KMeansResult, kmeans
from spmm_torch.solvers.status import Status


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def make_blobs(points: int = 2000, blobs: int = 10, spread: float = 0.3) -> Tensor:
    generator = seeded()
    centers = torch.randn(blobs, 6, generator=generator)
    chosen = torch.randint(blobs, (points,), generator=generator)
    return centers[chosen] + spread * torch.randn(points, 6, generator=generator)


def check(points: Tensor, found: KMeansResult, clusters: int) -> None:
    """No cluster is empty, centres are means, and the objective is the direct one."""
    assert found.centers.shape == (clusters, points.shape[1])
    assert found.labels.unique().tolist() == list(range(clusters))
    means = torch.stack([points[found.labels == c].mean(0) for c in range(clusters)])
    torch.testing.assert_close(found.centers, means, rtol=1e-4, atol=1e-4)
    direct = (points - found.centers[found.labels]).square().sum().item()
    assert found.objective == pytest.approx(direct, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("spread", [0.1, 0.5])
@pytest.mark.parametrize("k", [2, 10, 25])
def test_objective_is_close_to_scikit_learn(k: int, spread: float) -> None:
    points = make_blobs(spread=spread)
    found = min((kmeans(points, k, seeded(s)) for s in range(3)), key=lambda r: r.objective)
    check(points, found, k)
    oracle = KMeans(k, init="k-means++", n_init=3, random_state=0).fit(points.numpy())
    assert found.objective <= 1.02 * oracle.inertia_


def test_labels_are_nearest_centers_at_convergence() -> None:
    points = make_blobs()
    found = kmeans(points, 8, seeded(), iterations=1000)
    assert torch.equal(torch.cdist(points, found.centers).argmin(1), found.labels)


def test_same_seed_same_bytes() -> None:
    points = make_blobs()
    first, second = kmeans(points, 8, seeded(3)), kmeans(points, 8, seeded(3))
    assert torch.equal(first.labels, second.labels)
    assert torch.equal(first.centers, second.centers)


def test_blocks_change_nothing() -> None:
    points = make_blobs()
    whole = kmeans(points, 8, seeded())
    assert torch.equal(whole.labels, kmeans(points, 8, seeded(), block=999).labels)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("distinct", [1, 3, 8])
def test_fewer_distinct_points_than_clusters(distinct: int, dtype: torch.dtype) -> None:
    different = 100 + 1e-3 * torch.randn(distinct, 4, generator=seeded(), dtype=dtype)
    points = different[torch.arange(60) % distinct]
    found = kmeans(points, 8, seeded())
    check(points, found, distinct)
    assert found.centers.dtype == dtype
    assert found.objective == 0.0
    assert all(len(found.labels[i::distinct].unique()) == 1 for i in range(distinct))


def test_points_within_their_resolution_are_one() -> None:
    """Coordinates of equal texels differ by rounding, which must not make clusters."""
    points = torch.tensor([0.0, 1.0, 9.0])[torch.arange(60) % 3, None].expand(60, 4)
    noisy = points + 1e-6 * torch.randn(60, 4, generator=seeded())
    found = kmeans(noisy, 8, seeded(), resolution=torch.full((60,), 1e-4))
    assert len(found.centers) == 3
    assert len(kmeans(noisy, 8, seeded()).centers) == 8


def test_as_many_clusters_as_points_and_one_point() -> None:
    points = torch.randn(7, 3, generator=seeded())
    check(points, kmeans(points, 7, seeded()), 7)
    check(points, kmeans(points, 1, seeded()), 1)
    check(points[:1], kmeans(points[:1], 5, seeded()), 1)


def test_empty_clusters_get_the_farthest_points() -> None:
    points = torch.tensor([[0.0], [0.1], [0.2], [5.0], [9.0]], dtype=torch.float64)
    centers = torch.tensor([[0.1], [50.0], [60.0]], dtype=torch.float64)
    labels, distance = module._assign(points, centers)
    filled = module._fill_empty(points, labels, distance, 3)
    assert filled.tolist() == [0, 0, 0, 2, 1]


def test_bad_input_is_refused() -> None:
    points = make_blobs(20)
    with pytest.raises(ConfigError, match="at least 1"):
        kmeans(points, 0, seeded())
    with pytest.raises(DataError, match="at least 1"):
        kmeans(points[:0], 2, seeded())
    with pytest.raises(DataError, match="finite"):
        kmeans(torch.full_like(points, torch.nan), 2, seeded())


def test_whole_weights_are_repeated_points() -> None:
    points = make_blobs(points=200, blobs=3)
    times = torch.randint(1, 4, (200,), generator=seeded(5))
    weighted = kmeans(points, 3, seeded(), weights=times.double())
    again = torch.repeat_interleave(torch.arange(200), times)
    repeated = kmeans(points[again], 3, seeded())
    assert weighted.objective == pytest.approx(repeated.objective, rel=1e-6)
    means = torch.stack([points[again][weighted.labels[again] == c].mean(0) for c in range(3)])
    torch.testing.assert_close(weighted.centers, means, rtol=1e-4, atol=1e-4)
    same = kmeans(points, 3, seeded(), weights=torch.ones(200))
    assert torch.equal(same.labels, kmeans(points, 3, seeded()).labels)


def test_ends_converged_or_at_the_limit_of_iterations() -> None:
    points = make_blobs(spread=0.5)
    whole = kmeans(points, 25, seeded())
    assert whole.status is Status.CONVERGED
    cut = kmeans(points, 25, seeded(), iterations=1)
    assert cut.status is Status.LIMIT and cut.objective > whole.objective
    distinct = kmeans(points[:3].repeat(10, 1), 8, seeded(), iterations=0)
    assert distinct.status is Status.CONVERGED
