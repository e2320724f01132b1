"""Scripts that print figures lie in tests/benchmarks, and say how they are run."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import glossy, locations, measured
from tests.locations import ROOT

TESTS = ROOT / "tests"
SCRIPTS = sorted((TESTS / "benchmarks").glob("*.py"))


def prints(path: Path) -> bool:
    """Whether a module prints to standard output."""
    calls = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
    return any(
        getattr(call.func, "id", "") == "print" and "file" not in [key.arg for key in call.keywords]
        for call in calls
    )


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_the_docstring_names_the_command(path: Path) -> None:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert f"python -m tests.benchmarks.{path.stem}" in docstring


def test_nothing_else_prints_figures() -> None:
    assert {path for path in TESTS.rglob("*.py") if prints(path)} == set(SCRIPTS)


@pytest.mark.parametrize(
    ("read", "file"),
    [
        (glossy.material_names, "rgl_brdfs.npz"),
        (lambda: glossy.material("chm_orange", 81), "rgl_brdfs.npz"),
        (measured.measured_names, "measured_brdfs.npz"),
        (lambda: next(measured.measured_means()), "measured_mean_reflectance.npz"),
    ],
)
def test_missing_data_are_named(
    read: Callable[[], object], file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scripts ended in a traceback of NumPy."""
    monkeypatch.setattr(locations, "DATA", tmp_path)
    with pytest.raises(SystemExit, match=f"no {file} in .*SPMM_TEST_DATA"):
        read()
