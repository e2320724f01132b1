"""Runs that the viewers are tried on."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch import SPMM
from spmm_torch.runtime.tensor_file import MODEL_FILE
from tests.render.planted import planted_model


@pytest.fixture
def model() -> SPMM:
    """Eight by eight texels of three lobes."""
    return planted_model()


@pytest.fixture
def run(tmp_path: Path, model: SPMM) -> Path:
    """Its run folder, with nothing but the model."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / MODEL_FILE).write_bytes(model.pack())
    return folder
