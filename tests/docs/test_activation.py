"""What a new user is told after `make demo` puts the command on the PATH."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from spmm_torch import __version__
from tests.docs.markdown import blocks, name_of
from tests.locations import ROOT

ACTIVATION = re.compile(r"(?:source|\.) (\.venv)/bin/activate")
README = ROOT / "README.md"
TOLD = [README, ROOT / "CONTRIBUTING.md", ROOT / "docs/tutorials/fit_and_read.md"]


def printed(target: str) -> str:
    """What a target of the Makefile prints."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert recipe is not None
    lines = re.findall(r'^\t@echo "(.*)"$', recipe[1], re.MULTILINE)
    return "\n".join(lines).replace("$(VENV)", ".venv")


def activates(text: str) -> bool:
    """Whether the line of a text that enters the environment finds `spmm`, from an empty PATH."""
    said = ACTIVATION.search(text)
    assert said is not None
    line = said[0].replace(said[1], sys.prefix)
    shown = subprocess.run(
        ["bash", "-c", f"{line} && spmm --version"],
        env={key: value for key, value in os.environ.items() if key != "VIRTUAL_ENV"}
        | {"PATH": os.defpath},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    return shown.stdout.strip() == __version__


@pytest.mark.skipif(
    not Path(sys.prefix, "bin", "activate").is_file() or shutil.which("bash") is None,
    reason="the tests run outside of an environment, or there is no bash",
)
@pytest.mark.parametrize("path", [None, *TOLD], ids=lambda path: name_of(path) if path else "make")
def test_the_line_that_is_told_finds_spmm(path: Path | None) -> None:
    assert activates(printed("demo") if path is None else path.read_text(encoding="utf-8"))


def test_readme_tells_it_before_the_first_command() -> None:
    lines = README.read_text(encoding="utf-8").splitlines()
    first = next(block.line for block in blocks(README) if block.text.startswith("spmm "))
    assert any(ACTIVATION.search(line) for line in lines[: first - 1])
