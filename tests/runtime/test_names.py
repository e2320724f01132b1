"""Paths of files in locales that are not UTF-8."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from spmm_torch.runtime.names import path_of, text_of

NAME = "M\u00fcnchen"
# The script that a process of another locale runs in a folder of that name, all of it ASCII.
SCRIPT = r"""
import os, sys
from pathlib import Path
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.written import load_yaml
from spmm_torch.runtime.atomic import zip_member
from spmm_torch.runtime.names import path_of, text_of

assert sys.getfilesystemencoding() == "ascii"
(named,) = load_yaml("names.yaml")
assert Path(named).is_dir() and Path(path_of("M\u00fcnchen")).is_dir()
assert text_of(named) == zip_member(named).filename == "M\u00fcnchen"
config = FitConfig().changed({"weights.scene": str(named)})
Path("settings.yaml").write_text(config.to_yaml(), encoding="utf-8")
assert FitConfig.from_yaml("settings.yaml") == config
"""


@pytest.mark.parametrize("name", [NAME, "plain", os.fsdecode(b"caf\xe9")])
def test_in_a_locale_of_utf_8_both_are_the_same(name: str) -> None:
    assert path_of(name) == text_of(name) == name


def test_files_name_paths_in_utf_8_whatever_the_locale(tmp_path: Path) -> None:
    (tmp_path / NAME).mkdir()
    (tmp_path / "names.yaml").write_text(f"[{NAME}]", encoding="utf-8")
    locale = {"LC_ALL": "C", "PYTHONUTF8": "0"}
    command = [sys.executable, "-c", SCRIPT]
    subprocess.run(command, cwd=tmp_path, env=os.environ | locale, check=True)
