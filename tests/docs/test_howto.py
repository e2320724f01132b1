"""The Python of README and docs/howto.md runs as it stands."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.geometry.directions import ring_directions
from tests.docs.markdown import blocks, name_of
from tests.docs.running import run_blocks
from tests.locations import DOCS, ROOT

PAGES = [pytest.param(path, id=name_of(path)) for path in (ROOT / "README.md", DOCS / "howto.md")]


@pytest.mark.parametrize("path", PAGES)
def test_python_runs(
    path: Path, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run, tmp_path / "runs" / "wool")
    directions = ring_directions(((0.0, 1), (40.0, 6))).numpy()
    values = np.random.default_rng(0).uniform(0.1, 0.3, (7, 7, 2, 2, 3)).astype(np.float32)
    with (tmp_path / "WOOL.zip").open("wb") as file:  # the content tells the format
        np.savez(file, values=values, view=directions, light=directions)
    parts = blocks(path, "python")
    assert parts
    run_blocks(path, parts)
