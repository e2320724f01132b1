"""The benchmark runs; what it measures is for people to read."""

from __future__ import annotations

from spmm_torch.render import RenderSettings
from tests.benchmarks.render_sphere import benchmark
from tests.planted.materials import Lambertian
from tests.planted.models import planted_model


def test_parts_are_measured() -> None:
    seconds = benchmark(planted_model(), RenderSettings(size=8, samples=1), repeats=1)
    assert set(seconds) == {"whole", "trace", "material", "lobes", "rest", "queries"}
    assert seconds["whole"] > 0.0
    assert "lobes" not in benchmark(Lambertian(), RenderSettings(size=8, samples=1), repeats=1)
