"""The folder for Mitsuba: rendered by its own loader, and measured through the plug-in."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from spmm_torch import SPMM, OutputError
from spmm_torch.config.synthesis import FAST
from spmm_torch.export import TARGETS, NoSettings
from spmm_torch.export import mitsuba as target
from spmm_torch.export.written import export
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize.variant import works
from tests.planted.models import planted_model, with_components, with_relief

QUIET = Progress(enabled=False)
WHOLE = with_relief(with_components(planted_model(size=4, residual=0.02), beside=True))


def test_the_scene_renders_as_it_is(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba", reason="needs the extra mitsuba")
    out = tmp_path / "folder"
    outcome = export(WHOLE, TARGETS["mitsuba"], out, NoSettings(), QUIET)
    variant = FAST if works(FAST) else "scalar_rgb"
    assert outcome.left_out == (() if variant == FAST else (target.UNMEASURED,))
    if variant == FAST:
        assert outcome.loss.snr_db > 100.0
    command = [sys.executable, str(out / "render.py"), variant, "size=8", "samples=4"]
    subprocess.run(command, check=True, cwd=tmp_path, timeout=600)
    picture = OpenEXR.File(str(out / "picture.exr")).channels()["RGB"].pixels
    assert picture.shape == (8, 8, 3)
    assert np.isfinite(picture).all()
    assert picture[4, 4].min() > 0.0
    assert (out / "picture.png").stat().st_size > 0


def test_without_mitsuba_the_file_is_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(target, "plugin_variant", lambda: None)
    outcome = export(WHOLE, TARGETS["mitsuba"], tmp_path / "folder", NoSettings(), QUIET)
    assert outcome.left_out == (target.UNMEASURED,)
    assert isinstance(SPMM.load(tmp_path / "folder"), SPMM)


def test_a_full_disk_names_the_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OutputError, match=f"^{tmp_path / 'folder'} cannot be written"):
        export(WHOLE, TARGETS["mitsuba"], tmp_path / "folder", NoSettings(), QUIET)
    assert not list(tmp_path.iterdir())


def test_a_name_cannot_break_the_scene() -> None:
    model = planted_model(size=2, lobes_per_texel=1)
    model.name = "a --> <b> & c"
    assert "-->" not in target.scene_of(model).splitlines()[0].removesuffix("-->")
