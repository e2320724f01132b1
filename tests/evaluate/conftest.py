"""One run for all tests, and small pictures."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch.evaluate import spheres
from tests.evaluate.runs import SMALL, make_run, planted_btf, save


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spheres, "SETTINGS", SMALL)


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(planted_btf(), tmp_path_factory.mktemp("source") / "planted.npz")


@pytest.fixture(scope="session")
def run(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(source, tmp_path_factory.mktemp("runs") / "run")
