"""The parts of the benchmark of a GPU, by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch

from tests.benchmarks.on_gpu import fits, plugin, uses
from tests.benchmarks.on_gpu.measuring import measured
from tests.benchmarks.on_gpu.needs import TESTING, absent
from tests.benchmarks.on_gpu.rows import Put, Row
from tests.benchmarks.on_gpu.sizes import Sizes
from tests.locations import ROOT

COPY, PRODUCT = "copy", "matrix product, float32"
FLOAT = 4
MARK = "@pytest.mark.gpu"


def speed(device: str, sizes: Sizes, put: Put) -> None:
    """What the device can do: a copy and a product, which all others are held against."""
    where = torch.device(device)
    source = torch.rand(sizes.copied // FLOAT, device=device)
    target = torch.empty_like(source)
    measured(COPY, lambda: target.copy_(source), where, sizes.patience, put)
    matrix = torch.rand(sizes.product, sizes.product, device=device)
    measured(PRODUCT, lambda: matrix @ matrix, where, sizes.patience, put)


def tests(device: str, sizes: Sizes, put: Put) -> None:
    """The tests that want a GPU; in a dry run they have a simulated one.

    Raises:
        AssertionError: some failed.
    """
    if names := absent(TESTING):
        put(Row("tests marked gpu", note=f"skipped: {' and '.join(names)} not installed"))
        return
    import pytest

    counts = Outcomes()
    files = sorted({str(path) for path in (ROOT / "tests").rglob("test_*.py") if marked(path)})
    # Warnings of other versions of torch are no errors here.
    options = ("-q", "-m", "gpu", "-W", "default", "-p", "no:cacheprovider")
    code = pytest.main([*files, *options], [counts])
    put(Row("tests marked gpu", note=counts.text()))
    assert code == pytest.ExitCode.OK, counts.text()


def marked(path: Path) -> bool:
    """Whether a file has tests for a GPU."""
    return MARK in path.read_text(encoding="utf-8")


class Outcomes:
    """Counts outcomes of tests, as a plug-in of pytest."""

    def __init__(self) -> None:
        self.count = {"passed": 0, "failed": 0, "skipped": 0}

    def pytest_runtest_logreport(self, report: object) -> None:
        """Counts a test once: as it was called, or as it failed or was skipped before."""
        outcome, when = getattr(report, "outcome", ""), getattr(report, "when", "")
        if when == "call" or outcome != "passed":
            self.count[outcome] += 1

    def text(self) -> str:
        """The counts, in words."""
        return ", ".join(f"{count} {outcome}" for outcome, count in self.count.items())


PARTS: dict[str, Callable[[str, Sizes, Put], None]] = {
    "speed": speed,
    "agreement": fits.agreement,
    **fits.FITS,
    "triples": uses.triples,
    "rendering": uses.rendering,
    "sampling": uses.sampling,
    "training": uses.training,
    "mitsuba": plugin.pictures,
    "tests": tests,
}
