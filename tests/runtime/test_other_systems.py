"""A fit without what other systems lack: fcntl, resource, forks, posix_fallocate, /proc, a home."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest
import torch

from spmm_torch.data import cache
from spmm_torch.runtime import memory
from spmm_torch.runtime.lock import locked
from tests.locations import ROOT

# What macOS or Windows lack is taken away before anything of the package is imported.
WITHOUT = """
import os, sys
from pathlib import Path
for name in ("fcntl", "resource"):
    sys.modules[name] = None
for name in ("posix_fallocate", "sysconf", "getuid"):
    delattr(os, name)
import warnings
warnings.simplefilter("ignore")
import torch  # asks whether the system is Windows, not whether the name is there
del os.register_at_fork
from spmm_torch.runtime import memory
memory.MEMINFO = memory.STATUS = Path("/nowhere")
memory.CGROUPS = ()
from spmm_torch.cli import main
from tests.cli.test_terminal import OPTIONS, fit
OPTIONS += ["--cache", sys.argv[1] + "/cache"]
sys.exit(fit(Path(sys.argv[1])))
"""


def test_a_fit_without_them(tmp_path: Path) -> None:
    shown = subprocess.run(
        [sys.executable, "-c", WITHOUT, str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "run" / "model.safetensors").exists()
    assert list((tmp_path / "cache").glob("*.npy"))


@pytest.mark.parametrize("code", [errno.EOPNOTSUPP, errno.EINVAL, None])
def test_space_that_cannot_be_reserved(
    code: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(code, "no")

    if code is None:
        monkeypatch.delattr(os, "posix_fallocate")
    else:
        monkeypatch.setattr(os, "posix_fallocate", refuse)
    with (tmp_path / "a").open("w+b") as file:
        memory.reserve(file, 1 << 20)
        assert os.fstat(file.fileno()).st_size == 1 << 20
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            memory.reserve(file, 1 << 60)
    assert memory.scratch((3,), False, torch.device("cpu")).shape == (3,)


@pytest.mark.parametrize("home", ["", "~", "relative"])
def test_a_user_without_a_home(home: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: Path(home) / name)
    assert cache.default_folder().parent == tmp_path
    assert cache.entries() == [] and cache.clear() == (0, 0)


def test_a_user_whom_the_system_does_not_know(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_: str) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(platformdirs, "user_cache_path", unknown)
    assert cache.default_folder().is_absolute()


@pytest.mark.parametrize("code", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_the_cache_on_a_file_system_without_locks(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flock(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", flock)
    with pytest.warns(UserWarning, match="file system without locks"), locked(tmp_path / "lock"):
        pass


def test_a_lock_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"), locked(tmp_path / "file" / "lock"):
        pytest.fail("the body must not run")
