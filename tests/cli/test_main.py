"""The command `spmm`: help, version and unknown commands."""

from __future__ import annotations

import pytest

import spmm_torch
from spmm_torch.cli import main as cli
from spmm_torch.cli.main import COMMANDS, main


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr()
    assert all(f"  {name} " in shown.out for name in COMMANDS)
    assert shown.err == ""


def test_without_arguments_it_is_bad_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli.sys, "argv", ["spmm"])
    assert main() == 2
    assert "usage: spmm COMMAND" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == spmm_torch.__version__


def test_unknown_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fitt", "x"]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("error: unknown command fitt; expected one of fit")
    assert shown.err.count("\n") == 1


def test_a_command_gets_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[list[str]] = []

    def command(arguments: list[str]) -> int:
        given.append(arguments)
        return 7

    monkeypatch.setitem(COMMANDS, "fit", (command, "fit"))
    assert main(["fit", "IN", "-o", "RUN", "--help"]) == 7
    assert given == [["IN", "-o", "RUN", "--help"]]


def test_help_of_fit_explains_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["fit", "--help"])
    assert caught.value.code == 0
    shown = capsys.readouterr().out
    for key in ("search.restarts", "stagewise.eta", "select.max_lobes", "--seed"):
        assert key in shown
