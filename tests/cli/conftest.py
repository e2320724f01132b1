"""A run for commands that need no more than a model."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.planted.models import planted_model
from tests.planted.runs import model_folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with nothing but a model of eight by eight texels."""
    return model_folder(tmp_path / "run", planted_model())
