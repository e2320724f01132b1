"""The examples of docs/extending.md work when pasted into a copy of the repository."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.docs.markdown import patched
from tests.docs.running import run_process
from tests.locations import DOCS, ROOT

PAGE = DOCS / "extending.md"
# Folders of the checkout, and where they lie in the copy: installed, cli is a part of the package.
FOLDERS = {"spmm_torch": "spmm_torch", "cli": "spmm_torch/cli", "tests": "tests"}
FOLDERS |= {"viz": "spmm_torch/viz", "configs": "configs"}
FILE = re.compile(r"^(?:New file|One line in|Two (?:lines|places) in) `([^`]+)`:$")
PROGRAMS = {"python": (), "spmm": ("-m", "spmm_torch.cli.main")}
SECONDS = 500


def blocks(title: str) -> list[tuple[str, str, str]]:
    """(file to paste into, language, text) of each block of a section."""
    page = PAGE.read_text(encoding="utf-8")
    section = page.split(f"\n## {title}\n")[1].split("\n## ")[0]
    found, file, lines = [], "", iter(section.splitlines())
    for line in lines:
        if line.startswith("```"):
            body = iter(lambda: next(lines), "```")
            found.append((file, line[3:], "".join(f"{text}\n" for text in body)))
        elif line.strip():
            file = match[1] if (match := FILE.match(line)) else ""
    return found


def commands(title: str) -> list[list[str]]:
    """What Python is to run for each command of a section."""
    texts = [text for _, language, text in blocks(title) if language == "sh"]
    found = [shlex.split(line) for text in texts for line in text.splitlines()]
    return [[*PROGRAMS[words[0]], *words[1:]] for words in found]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory, run: Path) -> Path:
    """A copy of the repository with all examples pasted, and a run."""
    folder = tmp_path_factory.mktemp("copy")
    for source, target in FOLDERS.items():
        ignored = shutil.ignore_patterns("__pycache__", "docs")
        shutil.copytree(ROOT / source, folder / target, ignore=ignored)
    shutil.copy(ROOT / "setup.cfg", folder)
    shutil.copytree(run, folder / "runs" / "weave")
    for title in SECTIONS:
        for file, language, text in blocks(title):
            path = folder / file
            if language in ("python", "yaml") and file:
                assert not path.exists(), f"{file} is there already"
                path.write_text(text, encoding="utf-8")
            elif language == "diff":
                path.write_text(patched(path.read_text(encoding="utf-8"), text), encoding="utf-8")
    return folder


SECTIONS = ("A BRDF", "A picture format", "A reader", "A writer", "An edit, a mask")
TOGETHER = """
import numpy as np, torch
from pathlib import Path
from spmm_torch import FitConfig, load_btf
from spmm_torch.brdf import MODEL_NAMES, PAPER_MODELS, REGISTRY
from spmm_torch.data.codecs import codec_of
from spmm_torch.data.writers import writer_of
from spmm_torch.errors import DataError

assert FitConfig().override(["search.models=[minnaert]"]).search.models == ("minnaert",)
assert "minnaert" not in PAPER_MODELS and REGISTRY[-1].title == "Minnaert"

picture = np.arange(24, dtype="<f4").reshape(2, 4, 3)
payload = b"PF\\n4 2\\n-1.0\\n" + picture[::-1].tobytes()
assert codec_of(payload).TITLE == "PFM"
assert (codec_of(payload).decode(payload) == picture).all()
folder = Path("pictures")
folder.mkdir()
for light in (0, 45):
    (folder / f"tl{light:03} pl000 tv000 pv000.pfm").write_bytes(payload)
btf = load_btf(folder)
assert btf.texels().shape == (8, 2, 3) and btf.bytes_per_value == 4

writer = writer_of("wool.stack")
writer.write("wool.stack", btf, writer.settings(half=True), None)
found = load_btf("wool.stack")
assert torch.equal(found.texels(), btf.texels()) and found.bytes_per_value == 2
Path("wool.stack/directions.json").write_text("{}")
try:
    load_btf("wool.stack")
except DataError as error:
    assert "expected a folder with values.npy and directions.json" in str(error)
"""


def test_all_examples_work_together(copy: Path) -> None:
    run_process(copy, *["-c", TOGETHER], seconds=SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("title", [title for title in SECTIONS if commands(title)])
def test_commands(copy: Path, title: str) -> None:
    for words in commands(title):
        run_process(copy, *words, seconds=SECONDS)
