"""Few queries and small spheres: what a loss measures is told by them as well."""

from __future__ import annotations

import pytest

from spmm_torch.export import loss
from spmm_torch.render import RenderSettings


@pytest.fixture(autouse=True)
def quick_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loss, "QUERIES", 1 << 10)
    monkeypatch.setattr(loss, "SETTINGS", RenderSettings(size=24, samples=1))
