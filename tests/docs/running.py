"""Runs the blocks of a document as a reader would, and compares what they print."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from spmm_torch.cli.main import main
from tests.docs.markdown import Block, blocks, name_of
from tests.locations import CONFIGS, ROOT

# Printed numbers may differ by a tenth, or by one in the last digit: machines round differently.
RELATIVE = 0.1
NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?![\w])")


def checkout(folder: Path) -> None:
    """Makes `folder` look like a checkout to blocks that name the sample or the settings."""
    (folder / "spmm_torch").mkdir()
    (folder / "spmm_torch" / "data").symlink_to(ROOT / "spmm_torch" / "data")
    (folder / "configs").symlink_to(CONFIGS)


def run_document(path: Path) -> None:
    """Runs all blocks of a document in the current folder; see `run_blocks`."""
    run_blocks(path, blocks(path))


def run_blocks(path: Path, parts: Sequence[Block]) -> None:
    """Runs blocks of Python and of commands in their order, in the current folder.

    Args:
        path: of the document.
        parts: its blocks; those of text hold what the one before them prints.

    Raises:
        AssertionError: a command fails, or a block prints something else.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    printed = ""
    for block in parts:
        if block.language == "python":
            printed = run_python(path, block, names)
        elif block.language == "sh":
            run_commands(block)
        elif block.language == "text":
            assert_alike(printed, block.text, f"{name_of(path)}:{block.line}")


def run_python(path: Path, block: Block, names: dict[str, Any]) -> str:
    """Runs a block, whose lines messages count as in the document; returns what it prints."""
    out = io.StringIO()
    code = compile("\n" * (block.line - 1) + block.text, str(path), "exec", dont_inherit=True)
    with contextlib.redirect_stdout(out):
        exec(code, names)
    return out.getvalue()


def run_commands(block: Block) -> None:
    """Runs the `spmm` commands of a block."""
    for line in block.text.splitlines():
        command, *arguments = shlex.split(line, comments=True)
        assert command == "spmm", line
        assert main(arguments) == 0, line


def assert_alike(found: str, expected: str, where: str) -> None:
    """Compares printed lines: words exactly, numbers within the tolerance."""
    assert NUMBER.sub("#", found).split() == NUMBER.sub("#", expected).split(), where
    for number, wanted in zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True):
        digit = 10.0 ** -len(wanted.partition(".")[2])
        bound = max(RELATIVE * abs(float(wanted)), digit)
        assert abs(float(number) - float(wanted)) <= 1.001 * bound, f"{where}: {found}"


def run_process(folder: Path, *words: str, seconds: float) -> str:
    """The output of Python in a folder that holds a copy of the package."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=seconds,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
