"""Every path, link and command that a document names is there."""

from __future__ import annotations

import importlib.util
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from spmm_torch import FitConfig
from spmm_torch.cli.main import main
from tests.docs.markdown import blocks, documents, name_of, prose
from tests.locations import ROOT

DOCUMENTS = [pytest.param(path, id=name_of(path)) for path in documents()]
# Languages of blocks that hold command lines.
SHELL = ("", "sh", "bash", "console")
# Folders that commands make, and what only a reader has.
MADE = ("runs/", "build/", "dist/", "drawn/", "compared/", "/")
PATH = re.compile(r"[\w.*-]+(?:/[\w.*-]+)*(?:/[\w*-]+(?:\.\w+)+|/)")
# How a document announces a file that its reader is to make.
NEW = re.compile(r"\bnew file `([^`]+)`", re.IGNORECASE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
OPTION = re.compile(r"--[a-z][a-z-]*|-[a-z]\b")


@dataclass(frozen=True)
class Command:
    """A command line of a document."""

    words: tuple[str, ...]
    line: int

    @property
    def options(self) -> list[str]:
        """Names of its options, without values."""
        given = (OPTION.match(word) for word in self.words[1:])
        return [option[0] for option in given if option]

    def after(self, option: str) -> list[str]:
        """The words that follow each mention of an option."""
        pairs = zip(self.words, self.words[1:], strict=False)
        return [value for name, value in pairs if name == option]


def spans(path: Path) -> Iterator[tuple[int, str]]:
    """(line, text) of what stands in backticks outside of blocks."""
    for number, line in prose(path):
        yield from ((number, span) for span in re.findall(r"`([^`]+)`", line))


def commands(path: Path, *names: str) -> list[Command]:
    """The command lines that begin with one of `names`, in blocks and in backticks."""
    lines = list(spans(path))
    for block in blocks(path, *SHELL):
        lines += enumerate(block.text.splitlines(), block.line)
    found = []
    for number, line in lines:
        if line.split(" ")[0] in names:
            found.append(Command(tuple(shlex.split(line, comments=True)), number))
    return found


@cache
def targets() -> frozenset[str]:
    """The targets of the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return frozenset(re.findall(r"^([a-z][a-z-]*):", text, re.MULTILINE))


@pytest.fixture
def help_of(capsys: pytest.CaptureFixture[str]):  # noqa: ANN201
    """What `spmm COMMAND --help` prints."""

    def ask(command: str) -> str:
        capsys.readouterr()
        try:
            code = main([command, "--help"])
        except SystemExit as stop:
            code = stop.code
        assert not code, f"spmm {command} is no command"
        return capsys.readouterr().out

    return ask


def missing_paths(path: Path) -> list[str]:
    """Paths in backticks and in blocks of commands that are not there, and are not to be made."""
    named = list(spans(path))
    new = set(NEW.findall(path.read_text(encoding="utf-8")))
    for block in blocks(path, *SHELL):
        named += enumerate(block.text.splitlines(), block.line)
    missing = []
    for number, text in named:
        for word in re.split(r"[\s,;='\"()]+", text):
            if not PATH.fullmatch(word) or word in new or word.startswith(MADE):
                continue
            if not exists(path, word):
                missing.append(f"{number}: {word}")
    return missing


def exists(path: Path, name: str) -> bool:
    """Whether a path or a pattern is there, from the root or beside the document."""
    return any(any(folder.glob(name.rstrip("/"))) for folder in (ROOT, path.parent))


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_path_is_there(path: Path) -> None:
    assert missing_paths(path) == []


def headings(path: Path) -> set[str]:
    """The anchors of a document's headings, as GitHub makes them."""
    lines = [line.lstrip("#").strip() for _, line in prose(path) if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_link_leads_somewhere(path: Path) -> None:
    dead = []
    for number, line in prose(path):
        for link in LINK.findall(line):
            target, _, anchor = link.partition("#")
            file = path.parent / target if target else path
            if "://" in link:
                continue
            if not file.exists() or (anchor and anchor not in headings(file)):
                dead.append(f"{number}: {link}")
    assert dead == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_target_of_make_is_there(path: Path) -> None:
    for command in commands(path, "make"):
        wanted = {word for word in command.words[1:] if "=" not in word}
        assert wanted <= targets(), command


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_command_is_one(path: Path, help_of) -> None:  # noqa: ANN001
    for command in commands(path, "spmm"):
        if len(command.words) == 1 or command.words[1] == "COMMAND":
            continue
        if command.words[1].startswith("-"):
            assert command.words[1] in ("--help", "--version"), command
            continue
        known = OPTION.findall(help_of(command.words[1]))
        assert set(command.options) <= set(known), command


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_setting_is_one(path: Path) -> None:
    if path.name == "extending.md":
        pytest.skip("its commands name what its examples add; test_plug_ins.py runs them")
    for command in commands(path, "spmm", "python", "torchrun"):
        FitConfig().override([word for word in command.after("--set") if "=" in word])


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_module_and_script_is_there(path: Path) -> None:
    for command in commands(path, "python", "torchrun"):
        if len(command.words) == 1:
            continue
        (module, *_) = command.after("-m") or (command.words[1],)
        if module.startswith(("spmm_torch", "tests.")):
            assert importlib.util.find_spec(module) is not None, command
            module = f"{module.replace('.', '/')}.py"
        script = ROOT / module
        if script.is_file():
            source = script.read_text(encoding="utf-8")
            for option in command.options:
                assert option in ("-m", "-o") or option.lstrip("-") in source, command


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_test_is_there(path: Path) -> None:
    for command in commands(path, "pytest"):
        assert all((ROOT / word).exists() for word in command.words if "/" in word), command


def test_the_search_sees_what_is_wrong(tmp_path: Path, help_of) -> None:  # noqa: ANN001
    page = tmp_path / "page.md"
    page.write_text(
        "`spmm_torch/nowhere.py`, `cli/main.py` and `runs/x.json`; new file `cli/x.py`\n"
        "```\nspmm fit X -o Y --nonsense  # --comment\n```\n",
        encoding="utf-8",
    )
    assert missing_paths(page) == ["1: spmm_torch/nowhere.py"]
    (command,) = commands(page, "spmm")
    assert command.options == ["-o", "--nonsense"]
    assert "--nonsense" not in help_of("fit")
    with pytest.raises(AssertionError, match="no command"):
        help_of("nonsense")
