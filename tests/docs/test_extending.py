"""The examples of docs/extending.md work when pasted."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from tests.docs.markdown import FENCE, Block, patched
from tests.docs.running import run_blocks, run_process
from tests.locations import DOCS, ROOT

PAGE = DOCS / "extending.md"
# Where the parts of the package lie in a checkout, and where in an installed one.
PARTS = {"spmm_torch": ".", "cli": "cli", "viz": "viz", "configs": "configs"}
FILE = re.compile(r"^(?:New file|\w+ lines? in) `([^`]+)`:$")
ENTRY = "import sys; from spmm_torch.cli.main import main; sys.exit(main())"
SECONDS = 300


def sections() -> dict[str, list[tuple[str | None, Block]]]:
    """The blocks of each section, with the file that a block is to be pasted into."""
    found: dict[str, list[tuple[str | None, Block]]] = {}
    title, file, language, text = "", None, None, ""
    for number, line in enumerate(PAGE.read_text(encoding="utf-8").splitlines(), 1):
        if fence := FENCE.match(line):
            if language is None:
                language, text, start = fence[1], "", number + 1
            else:
                into = None if language == "sh" else file
                found[title].append((into, Block(language, text, start)))
                language = None
        elif language is not None:
            text += f"{line}\n"
        elif line.startswith("#"):
            title = line.strip("# ")
            found[title] = []
        elif line.strip():
            file = FILE.match(line)[1] if FILE.match(line) else None
    return found


def paste(folder: Path, file: str, block: Block) -> None:
    """Makes a file of a block, or changes one as a diff says."""
    path = folder / file
    if block.language == "diff":
        path.write_text(patched(path.read_text(encoding="utf-8"), block.text), encoding="utf-8")
    else:
        assert not path.exists(), f"{file} is there already"
        path.write_text(block.text, encoding="utf-8")


@pytest.fixture
def copy(tmp_path: Path, run: Path) -> Path:
    """A folder with a copy of the package, and a run."""
    for part, place in PARTS.items():
        target = tmp_path / "spmm_torch" / place
        shutil.copytree(ROOT / part, target, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(run, tmp_path / "runs" / "weave")
    return tmp_path


@pytest.fixture
def python(copy: Path) -> Callable[..., str]:
    """Runs Python on the copy."""

    return partial(run_process, copy, seconds=SECONDS)


def pasted(copy: Path, title: str) -> list[list[str]]:
    """Pastes the blocks of a section; returns the words of its commands."""
    commands = []
    for file, block in sections()[title]:
        if file is not None:
            paste(copy, file, block)
        elif block.language == "sh":
            commands += [line.split()[1:] for line in block.text.splitlines()]
    assert commands
    return commands


def test_a_figure(copy: Path, python: Callable[..., str]) -> None:
    for words in pasted(copy, "A figure"):
        python("-c", ENTRY, *words)
    assert (copy / "drawn" / "residual_gain.png").is_file()
    assert "mean_radiance" in (copy / "drawn" / "figures.json").read_text(encoding="utf-8")


PEER_ALONE = """
import types, torch
from spmm_torch.benchmark.peers import PEERS
from spmm_torch.benchmark.protocol import Protocol
(peer,) = (peer for peer in PEERS if peer.name == "global PCA")
signals = torch.rand(20, 3, generator=torch.Generator().manual_seed(0)) @ torch.rand(3, 90)
problem = types.SimpleNamespace(
    values=signals.view(20, 30, 3), byte_budget=2 * (90 + 3 * (20 + 90)),
    protocol=Protocol(1, 0.0), device=torch.device("cpu"),
)
(row,) = peer.run(problem)
assert row["bytes"] == problem.byte_budget, row
assert row["snr_db"] > 50.0, row
"""


def test_a_peer(copy: Path, python: Callable[..., str]) -> None:
    pasted(copy, "A peer of the benchmark")
    python("-c", PEER_ALONE)


@pytest.mark.slow
def test_a_peer_in_a_benchmark(copy: Path, python: Callable[..., str]) -> None:
    for words in pasted(copy, "A peer of the benchmark"):
        python("-c", ENTRY, *words)
    assert "global PCA" in (copy / "compared" / "benchmark.html").read_text(encoding="utf-8")


def test_shape_light_and_material(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(copy)
    run_blocks(
        PAGE,
        [block for title in ("A shape", "A light", "A material") for _, block in sections()[title]],
    )
