"""One small run for all tests of the documents."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch.cli.main import main
from spmm_torch.data import sample_path
from tests.locations import CONFIGS

SMALL = (
    f"--config={CONFIGS / 'smoke.yaml'}",
    "--crop=0,0,8,8",
    "--directions=2",
    "--set=cluster.count=3",
    "--device=cpu",
    "--no-render",
)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a corner of the bundled sample, in a second."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["fit", str(sample_path()), "-o", str(folder), *SMALL]) == 0
    return folder
