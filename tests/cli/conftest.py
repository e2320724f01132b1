"""A run for commands that need no more than a model, and commands that are to be refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from spmm_torch.cli.main import main
from tests.planted.models import planted_model
from tests.planted.runs import model_folder

PROGRESS = re.compile(r"(?!error)\w+: ")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with nothing but a model of eight by eight texels."""
    return model_folder(tmp_path / "run", planted_model())


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command that ends with code 2 and one sentence, which is returned.

    Lines of progress may stand before it.
    """

    def sentence(*words: object) -> str:
        capsys.readouterr()
        assert main([str(word) for word in words]) == 2
        shown = capsys.readouterr()
        *lines, last = shown.err.splitlines()
        assert shown.out == ""
        assert last.startswith("error: ")
        assert all(PROGRESS.match(line) for line in lines), lines
        return last.removeprefix("error: ")

    return sentence
