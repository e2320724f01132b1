"""What every export does: parts that are left out are named, and what was written is measured."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.edit.parts import flattened
from spmm_torch.errors import OutputError
from spmm_torch.export import TARGETS, Exported, Target, target
from spmm_torch.export.loss import loss_of, random_snr, without_parts
from spmm_torch.export.target import LOBES, PARTS, RELIEF, RESIDUAL, NoSettings
from spmm_torch.export.written import export, left_out
from spmm_torch.mitsuba.evaluation import plugin_variant
from spmm_torch.runtime.progress import Progress
from tests.planted.models import planted_model, with_components, with_relief, with_residual

QUIET = Progress(enabled=False)
NOTHING = Target("nothing", "nothing", "", ())


def test_left_out_parts_are_those_that_the_model_has() -> None:
    lobes = planted_model()
    whole = with_relief(with_components(lobes))
    assert left_out(lobes, NOTHING) == (PARTS[LOBES],)
    assert left_out(whole, NOTHING) == tuple(PARTS.values())
    assert left_out(with_residual(2), NOTHING) == (PARTS[LOBES], PARTS[RESIDUAL])
    assert left_out(whole, Target("x", "x", "", (LOBES, RESIDUAL, RELIEF))) == ()


def test_a_model_without_parts_is_what_a_target_can_hold() -> None:
    lobes = planted_model()
    whole = with_relief(with_components(lobes))
    assert random_snr(lobes, without_parts(whole, (LOBES,))) > 120.0
    assert random_snr(with_relief(lobes), without_parts(whole, (LOBES, RELIEF))) > 120.0
    assert random_snr(whole, flattened(whole)) < 60.0
    assert without_parts(lobes, ()) is lobes


def test_the_loss_is_that_of_the_material() -> None:
    model = with_components(planted_model(), size=0.02)

    def brighter(uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        return 1.1 * model(uv, wi, wo)

    loss = loss_of(model, (LOBES, RESIDUAL), brighter)
    assert loss.snr_db == pytest.approx(20.0, abs=1e-3)
    assert loss.held_snr_db == loss.snr_db
    assert loss.flip is None or min(loss.flip) > 0.0
    part = loss_of(model, (LOBES,), lambda *query: model(*query, residual=False))
    assert part.held_snr_db > 120.0 > part.snr_db
    assert "without what is left out" in part.line()


def failing(place: Path, model: SPMM, settings: NoSettings, progress: Progress) -> Exported:
    (place / "half").write_text("x", encoding="utf-8")
    raise OutputError("it does not go.")


def test_a_failed_export_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target.Target, "write", lambda self, *given: failing(*given))
    with pytest.raises(OutputError, match="does not go"):
        export(planted_model(size=2), NOTHING, tmp_path / "out", NoSettings(), QUIET)
    assert not list(tmp_path.iterdir())


def test_a_model_without_colours_is_refused(tmp_path: Path) -> None:
    model = planted_model(size=2)
    model.weight = torch.nn.Parameter(model.weight[:, :1])
    with pytest.raises(OutputError, match="has 1 channels; expected red, green and blue"):
        export(model, NOTHING, tmp_path / "out", NoSettings(), QUIET)


@pytest.mark.parametrize("name", ["exr", "osl", "web", "mitsuba"])
def test_a_folder_whose_name_is_no_utf_8(tmp_path: Path, name: str) -> None:
    """Libraries that take no such path are handed the file, or it is named."""
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 only")
    chosen = TARGETS[name]
    place = folder / f"out{chosen.suffix}"
    refused = name == "mitsuba" and plugin_variant() is not None
    if refused:
        with pytest.raises(OutputError, match="holds bytes that are no UTF-8"):
            export(planted_model(size=2), chosen, place, chosen.settings(), QUIET)
    else:
        export(planted_model(size=2), chosen, place, chosen.settings(), QUIET)
    assert place.exists() != refused
