"""A run that the viewers are tried on."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch import SPMM
from tests.planted.models import planted_model
from tests.planted.runs import model_folder


@pytest.fixture
def model() -> SPMM:
    """Eight by eight texels of three lobes."""
    return planted_model()


@pytest.fixture
def run(tmp_path: Path, model: SPMM) -> Path:
    """Its run folder, with nothing but the model."""
    return model_folder(tmp_path / "run", model)
