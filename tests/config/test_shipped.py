"""Settings that ship go by a name, from whatever folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch.config.fit import FitConfig
from spmm_torch.config.shipped import settings_of, shipped, shipped_names
from spmm_torch.errors import ConfigError
from tests.locations import CONFIGS


def test_names() -> None:
    assert shipped_names() == sorted(path.stem for path in CONFIGS.glob("*.yaml"))


@pytest.mark.parametrize("text", ["fast", "fast.yaml", "configs/fast.yaml", "configs/fast"])
def test_a_name_from_another_folder(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert settings_of(text) == FitConfig.from_yaml(CONFIGS / "fast.yaml") == shipped("fast")


def test_a_file_goes_before_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fast").write_text("seed: 3")
    assert settings_of("fast") == FitConfig(seed=3)


@pytest.mark.parametrize("text", ["fats", "other/fast.yaml", "fast.yml", "", "edits/fig6.yaml"])
def test_neither_is_refused(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"cannot be read"):
        settings_of(text)
