"""Help texts: quick, because nothing heavy is imported, and complete."""

from __future__ import annotations

import argparse
import subprocess
import sys

import pytest

from spmm_torch.cli.completion import actions
from spmm_torch.cli.main import COMMANDS, main, parser
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.schema import describe
from spmm_torch.config.synthesis import SynthesisSettings
from tests.locations import ROOT

# Python packages that take long to import, or are not everywhere.
HEAVY = {"torch", "numpy", "scipy", "PIL", "kornia", "skimage", "OpenEXR", "safetensors"}
HEAVY |= {"tqdm", "pyvista", "vtk", "trame", "trame_vtk", "mitsuba", "sklearn", "shtab"}
# The options of `spmm convert` are those of its writers, whose modules are imported for them.
WRITERS_NEED = {"numpy", "PIL"}
# With a module as the first argument, that module is run; any heavy import ends the process.
WITHOUT = f"""
import runpy, sys

heavy = {HEAVY!r} - ({WRITERS_NEED!r} if "convert" in sys.argv else set())

class Refuse:
    def find_spec(name, path=None, target=None):
        if name.split(".")[0] in heavy:
            raise SystemExit(f"{{name}} is imported")

sys.meta_path.insert(0, Refuse)
sys.argv = sys.argv[1:]
if sys.argv[0] == "spmm":
    from spmm_torch.cli.main import main
    sys.exit(main(sys.argv[1:]))
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


def without_heavy(*words: str) -> subprocess.CompletedProcess[str]:
    """A process that must not import what is heavy."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "words",
    [
        ["spmm", "--help"],
        ["spmm", "--version"],
        *(["spmm", name, "--help"] for name in COMMANDS),
        ["spmm_torch.fit", "--help"],
    ],
    ids=" ".join,
)
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    result = without_heavy(*words)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout


def test_the_hook_sees_a_heavy_import() -> None:
    result = without_heavy("spmm", "cache", "list")
    assert result.returncode == 1
    assert "is imported" in result.stderr


def test_a_checkout_that_is_not_installed_has_its_command() -> None:
    code = (
        "import runpy, sys\n"
        "from importlib.util import find_spec\n"
        "sys.meta_path = [item for item in sys.meta_path if '__editable__' not in str(item)]\n"
        "assert find_spec('spmm_torch.cli') is None\n"
        "sys.argv = ['', '--help']\n"
        "runpy.run_module('spmm_torch.fit', run_name='__main__', alter_sys=True)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "usage: spmm fit" in result.stdout


def shown_by(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    return shown.out


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown_by(["--help"], capsys)
    for name, command in COMMANDS.items():
        assert f"    {name:<12} {command.meaning}\n" in text  # each on one line


def test_help_of_fit_explains_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown_by(["fit", "--help"], capsys)
    for row in describe(FitConfig):
        assert f"\n  {row.key} = " in text


def test_help_of_synthesize_names_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown_by(["synthesize", "--help"], capsys)
    assert all(f"  --{name} " in text for name in SynthesisSettings.__dataclass_fields__)


def test_every_option_is_explained() -> None:
    for action in actions(parser()):
        assert action.help, action.option_strings


def test_defaults_are_told() -> None:
    """Of every option with a value that has one."""
    for action in actions(parser()):
        told = action.default in (None, argparse.SUPPRESS, []) or action.nargs == 0
        assert told or "(default: " in str(action.help), action.option_strings


def test_lists_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown_by(["edit", "--list"], capsys)
    for words in ("\n  intensity: ", "      factor = 1.0", "\n  rectangle: ", "name, required"):
        assert words in text
    assert "examples: fig" in text
    assert "figure10" in shown_by(["figures", "--list"], capsys)
