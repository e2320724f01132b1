"""The tutorials run as they stand, and print what they say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.running import assert_alike, checkout, run_document
from tests.locations import DOCS


@pytest.mark.parametrize(
    "path", [pytest.param(p, id=p.stem) for p in sorted((DOCS / "tutorials").glob("*.md"))]
)
def test_tutorial(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout(tmp_path)
    monkeypatch.chdir(tmp_path)
    run_document(path)


def test_outputs_are_compared() -> None:
    assert_alike("a 1.04 dB, b2", "a 1.00 dB, b2", "here")
    assert_alike("+0.01 dB", "-0.00 dB", "here")
    with pytest.raises(AssertionError):
        assert_alike("a 1.30 dB", "a 1.00 dB", "here")
    with pytest.raises(AssertionError):
        assert_alike("b 1.00 dB", "a 1.00 dB", "here")
