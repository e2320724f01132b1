"""`spmm completion`: scripts that shells accept and that know every command and option."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from spmm_torch.cli.completion import SHELLS, actions
from spmm_torch.cli.main import COMMANDS, main, parser

BASH = shutil.which("bash")
needs_bash = pytest.mark.skipif(BASH is None, reason="needs bash")


def script(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_and_option_is_there(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = script(shell, capsys)
    assert all(name in text for name in COMMANDS)
    for action in actions(parser()):
        assert all(option.lstrip("-") in text for option in action.option_strings)


def completions(text: str, words: list[str], folder: Path) -> list[str]:
    """What bash offers for the last of some words."""
    line = f"COMP_WORDS=({' '.join(map(repr, words))}); COMP_CWORD={len(words) - 1}"
    ask = f"{text}\n{line}\n_shtab_spmm spmm\nprintf '%s\\n' \"${{COMPREPLY[@]}}\"\n"
    result = subprocess.run(
        [str(BASH), "--norc"], input=ask, cwd=folder, capture_output=True, text=True, check=False
    )
    return result.stdout.split()


@needs_bash
def test_bash_accepts_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "spmm").write_text(script("bash", capsys))
    result = subprocess.run(
        [str(BASH), "-n", str(tmp_path / "spmm")], capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")


@needs_bash
def test_bash_completes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = script("bash", capsys)
    (tmp_path / "wool.zip").touch()
    offered = {
        ("spmm", "ev"): ["evaluate"],
        ("spmm", "fit", "--max"): ["--max-memory"],
        ("spmm", "fit", "wo"): ["wool.zip"],
        ("spmm", "fit", "x", "-o", "wo"): ["wool.zip"],
        ("spmm", "render", "--shape", "s"): ["sphere"],
    }
    for words, expected in offered.items():
        assert completions(text, list(words), tmp_path) == expected
