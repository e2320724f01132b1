"""The command `spmm`: the table of commands, exit codes, and how commands end."""

from __future__ import annotations

import errno
import inspect
import os
import signal
import subprocess
import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import spmm_torch
from spmm_torch.cli import cache, main
from spmm_torch.cli.main import COMMANDS, NOTHING_WRITTEN, STOPPED, module_of
from spmm_torch.cli.start import start
from spmm_torch.errors import DataError

FOLDER = Path(main.__file__).parent
# What commands share.
SHARED = {"__init__", "main", "start", "parser", "settings", "inputs", "source", "places", "editor"}


def test_every_file_is_a_command_or_shared() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == SHARED | set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_offer_the_same(name: str) -> None:
    module = module_of(name)
    assert list(inspect.signature(module.add_options).parameters) == ["parser"]
    assert list(inspect.signature(module.run).parameters) == ["options"]
    assert max(map(len, inspect.getdoc(module).splitlines())) < 80  # it is printed as it stands


def test_without_arguments_it_is_bad_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["spmm"])
    assert main.main() == 2
    assert "usage: spmm" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main.main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.strip() == spmm_torch.__version__


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["fitt", "x"], "error: argument COMMAND: invalid choice: 'fitt' (choose from"),
        (["--what"], "error: the following arguments are required: COMMAND; spmm --help tells"),
        (["fit", "x"], "error: the following arguments are required: -o/--output; spmm fit --help"),
        (["cache", "show"], "error: argument action: invalid choice: 'show'"),
        (["fit", "", "-o", "x"], "error: argument INPUT: '' is no name; expected that of a file"),
        (["cache", "list", "--what"], "error: unrecognized arguments: --what; spmm cache --help"),
    ],
)
def test_malformed_lines_are_one_sentence(
    words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(complaint)
    assert shown.err.endswith("tells what is expected.\n")
    assert shown.err.count("\n") == 1


def test_a_cache_that_is_none_or_empty(
    tmp_path: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "is no folder" in refused("cache", "clear", "--cache", tmp_path / "none")
    assert main.main(["cache", "list", "--cache", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path} keeps no BTF\n"


def test_a_command_gets_its_options_and_its_lines_are_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(options: Namespace) -> list[str]:
        return [options.action, str(options.cache)]

    monkeypatch.setattr(cache, "run", run)
    assert main.main(["cache", "list"]) == 0
    assert capsys.readouterr().out == "list\nNone\n"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (DataError("the sentence."), 2, "error: the sentence.\n"),
        (KeyboardInterrupt(), 130, "stopped.\n"),
    ],
)
def test_how_a_command_ends(
    error: BaseException,
    code: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def run(options: Namespace) -> list[str]:
        raise error

    monkeypatch.setattr(cache, "run", run)
    assert main.main(["cache", "list"]) == code
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", said)


def test_a_file_that_the_system_refuses(
    refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "/secret/wool.zip")

    monkeypatch.setattr(cache, "run", run)
    assert refused("cache", "list").startswith(
        "/secret/wool.zip cannot be used (Permission denied)"
    )


NO_LOCKS = """
import errno, fcntl, sys
def flock(*_):
    raise OSError(errno.ENOLCK, "No locks available")
fcntl.flock = flock
from spmm_torch.cli.main import main
sys.exit(main(["cache", "clear", "--cache", sys.argv[1]]))
"""


def test_a_warning_is_one_line(tmp_path: Path) -> None:
    """As of a cache on a file system without locks; Python would show a line of code as well."""
    (tmp_path / f"{'0' * 40}.json").write_text("{}")
    shown = subprocess.run(
        [sys.executable, "-c", NO_LOCKS, str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    assert shown.returncode == 0
    assert shown.stderr.startswith(f"warning: {tmp_path} lies on a file system without locks (")
    assert shown.stderr.count("\n") == 1


def test_bugs_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "run", lambda options: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main.main(["cache", "list"])


def test_what_a_stop_leaves_is_said() -> None:
    assert "--resume" in COMMANDS["fit"].stopped
    assert COMMANDS["convert"].stopped == NOTHING_WRITTEN


def test_a_reader_that_goes_away_is_no_error() -> None:
    """`spmm completion bash | head` ends quietly."""
    code = "from spmm_torch.cli.main import main; main(['completion', 'bash'])"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.communicate()[1] == b""
    assert process.returncode == 0


def test_ctrl_c_before_there_is_a_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupted(ModuleType):
        def __getattr__(self, name: str) -> object:
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "spmm_torch.cli.main", Interrupted("main"))
    monkeypatch.setattr(signal, "signal", lambda *given: ended.append(given))
    ended: list[object] = []
    assert start(["--version"]) == STOPPED
    assert capsys.readouterr().err == "stopped.\n"
    assert ended == [(signal.SIGINT, signal.SIG_DFL)]


def test_the_module_runs_commands() -> None:
    command = [sys.executable, "-m", "spmm_torch.cli.main", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, spmm_torch.__version__)


QUICK: dict[str, tuple[list[str], str]] = {
    "no input": (["fit", "no.zip", "-o", "r"], "no.zip does not exist"),
    "no setting": (["fit", "no.zip", "-o", "r", "--set=sead=1"], "did you mean seed"),
    "no settings": (["fit", "no.zip", "-o", "r", "--config=fats"], "fast, paper"),
    "no size": (["fit", "no.zip", "-o", "r", "--max-memory", "-1GB"], "'-1GB' is no size"),
    "run is there": (["fit", "no.zip", "-o", "there"], "there exists"),
    "no run": (["render", "no", "-o", "x.png"], "no does not exist"),
    "no run to judge": (["evaluate", "no"], "no does not exist"),
    "no run to draw": (["figures", "no", "-o", "x"], "no does not exist"),
    "no run to edit": (["edit", "no", "fig6", "-o", "x"], "no does not exist"),
    "no run to look at": (["view", "no", "--save", "x.png"], "no does not exist"),
    "a BTF for a run": (["render", "a.zip", "-o", "x.png"], "give --input a.zip to render a BTF"),
    "nowhere to write": (["render", "there", "-o", "no/x.png"], "no is no folder"),
    "a folder": (["render", "there", "-o", "there"], "there exists"),
}


def test_plain_mistakes_are_told_before_torch_is_imported(tmp_path: Path) -> None:
    """Torch takes seconds."""
    (tmp_path / "there").mkdir()
    (tmp_path / "a.zip").write_bytes(b"")
    code = (
        "import sys; from spmm_torch.cli.main import main\n"
        "for words in map(str.split, sys.argv[1:]):\n"
        "    assert main(words) == 2\n"
        "assert 'torch' not in sys.modules\n"
    )
    lines = [" ".join(words) for words, _ in QUICK.values()]
    shown = subprocess.run(
        [sys.executable, "-c", code, *lines], cwd=tmp_path, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    for (_, complaint), line in zip(QUICK.values(), shown.stderr.splitlines(), strict=True):
        assert line.startswith("error: ") and complaint in line


def test_threads_wait_without_spinning() -> None:
    code = (
        "import os; from spmm_torch.cli.main import main; main(['cache', 'show'])\n"
        "print(os.environ['OMP_WAIT_POLICY'])"
    )
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    for given, expected in (({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE")):
        shown = subprocess.run(
            [sys.executable, "-c", code],
            env=environment | given,
            capture_output=True,
            text=True,
            check=True,
        )
        assert shown.stdout.strip() == expected
