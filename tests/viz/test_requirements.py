"""What is missing on a machine ends in one sentence, not in a crash of VTK."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from spmm_torch.errors import ConfigError
from spmm_torch.viz import requirements
from spmm_torch.viz.requirements import require_packages, require_window, use_offscreen


def test_packages_that_are_there_pass() -> None:
    require_packages("spmm view", "torch", "numpy")


def test_a_missing_package_names_the_extra() -> None:
    with pytest.raises(ConfigError, match=r"needs no_such_thing, .* pip install 'spmm_torch\[viz"):
        require_packages("spmm view", "torch", "no_such_thing")


def test_without_any_library_the_sentence_names_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements.sys, "platform", "linux")
    monkeypatch.setattr(requirements, "can_load", lambda library: False)
    with pytest.raises(ConfigError, match="spmm view cannot draw: .* Debian package libegl1"):
        use_offscreen("spmm view")


@pytest.mark.parametrize(
    ("egl", "name"), [(True, "vtkEGLRenderWindow"), (False, "vtkOSOpenGLRenderWindow")]
)
def test_osmesa_stands_in_for_egl(egl: bool, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements.sys, "platform", "linux")
    monkeypatch.setattr(requirements, "egl_works", lambda: egl)
    monkeypatch.setattr(requirements, "can_load", lambda library: "OSMesa" in library)
    monkeypatch.setenv(requirements.WINDOW_CLASS, "before")
    use_offscreen("spmm view")
    assert os.environ[requirements.WINDOW_CLASS] == name


def test_a_library_that_is_not_there_cannot_be_loaded() -> None:
    assert not requirements.can_load("libNoSuchThing.so.9")


def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ConfigError, match="no display .* give --save"):
        require_window("spmm view")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(requirements, "display_works", lambda: True)
    require_window("spmm view")


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are asked for on Linux only")
def test_without_drivers_the_command_does_not_crash(run: Path, tmp_path: Path) -> None:
    """EGL finds no driver in an empty folder; VTK would abort the process."""
    if any(map(requirements.can_load, requirements.OSMESA)):
        pytest.skip("OSMesa stands in")
    pytest.importorskip("pyvista")
    target = tmp_path / "x.png"
    code = "import sys; from spmm_torch.cli.main import main; sys.exit(main(sys.argv[1:]))"
    result = subprocess.run(
        [sys.executable, "-c", code, "view", str(run), "--save", str(target)],
        env={**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": str(tmp_path / "none")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: spmm view cannot draw")
    assert result.stderr.count("\n") == 1
    assert not target.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no DISPLAY")
def test_a_display_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(ConfigError, match="finds no display .nothing answers at DISPLAY=:4711"):
        require_window("spmm view")
