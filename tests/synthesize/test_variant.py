"""Choosing a Mitsuba that works, without risking the process."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterator

import pytest

from spmm_torch.errors import ConfigError
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize import variant

SILENT = Progress(enabled=False)


@pytest.fixture(autouse=True)
def forget() -> Iterator[None]:
    """No test sees what another one found out."""
    variant.works.cache_clear()
    yield
    variant.works.cache_clear()


def test_without_mitsuba_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'spmm_torch\[mitsuba\]'"):
        variant.load_mitsuba("auto", 1, SILENT)


@pytest.mark.parametrize("probe", ["import os; os.abort()", "raise SystemExit(1)"])
def test_where_the_fast_variant_dies_the_plain_one_renders(
    monkeypatch: pytest.MonkeyPatch, probe: str
) -> None:
    pytest.importorskip("mitsuba")
    monkeypatch.setattr(variant, "PROBE", probe)
    stream = io.StringIO()
    mitsuba = variant.load_mitsuba("auto", 1, Progress(stream))
    assert mitsuba.variant() == variant.PLAIN
    assert stream.getvalue().count("\n") == 1
    assert "LLVM" in stream.getvalue()
    with pytest.raises(ConfigError, match="llvm_ad_rgb, which does not work on this machine"):
        variant.load_mitsuba(variant.FAST, 1, SILENT)


def test_a_probe_that_hangs_counts_as_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "PROBE", "import time; time.sleep(60)")
    monkeypatch.setattr(variant, "PROBE_SECONDS", 0.2)
    assert not variant.works(variant.FAST)


def test_an_unknown_variant_is_refused() -> None:
    pytest.importorskip("mitsuba")
    with pytest.raises(ConfigError, match="'gpu'; expected one of auto"):
        variant.load_mitsuba("gpu", 1, SILENT)


def test_the_probe_itself_renders() -> None:
    pytest.importorskip("mitsuba")
    subprocess.run([sys.executable, "-c", variant.PROBE, variant.PLAIN], check=True, timeout=120)
