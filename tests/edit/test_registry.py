"""The registries of edits and masks: a planted one of each is found by everything."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import pytest
import torch
import yaml

from spmm_torch import SPMM, ConfigError
from spmm_torch.cli.main import main
from spmm_torch.config.schema import setting
from spmm_torch.edit import EDITS, MASKS, Script, Selection, intensity, select_texels
from spmm_torch.runs.edited import edit_run
from spmm_torch.viz.editor.session import Session
from tests.edit.looks import check_valid, look
from tests.planted.runs import model_folder


@dataclass(frozen=True)
class Dim:
    """Darker by photographic stops."""

    stops: float = setting(1.0, "halvings of the light", low=0.0, high=8.0)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return intensity(model, 2.0**-self.stops, where)


@dataclass(frozen=True)
class ChessMask:
    """The black squares of a chess board."""

    side: int = setting(2, "texels along each side of a square", low=1)

    def select(self, model: SPMM) -> Selection:
        """Its texels in a model."""
        row = torch.arange(model.height)[:, None] // self.side
        column = torch.arange(model.width) // self.side
        return select_texels(model, (row + column) % 2 == 1)


SCRIPT = """
- dim: {stops: 2.0, mask: {chess: {side: 4}}}
- dim: {mask: {not: {chess: {}}}}
"""


@pytest.mark.parametrize("kind", [*EDITS.values(), *MASKS.values()], ids=[*EDITS, *MASKS])
def test_every_kind_is_frozen_and_says_what_it_means(kind: type) -> None:
    """The help text prints the docstring and the meanings of options."""
    assert kind.__dataclass_params__.frozen
    assert kind.__doc__
    assert "\n" not in kind.__doc__
    assert kind.__doc__.endswith(".")
    for item in fields(kind):
        assert len(item.metadata["meaning"]) > 5


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that it takes to add an edit and a mask."""
    monkeypatch.setitem(EDITS, "dim", Dim)
    monkeypatch.setitem(MASKS, "chess", ChessMask)


@pytest.fixture
def run(model: SPMM, tmp_path: Path) -> Path:
    """A run folder with nothing but a model."""
    return model_folder(tmp_path / "run", model)


@pytest.mark.usefixtures("registered")
def test_scripts_apply_them(model: SPMM) -> None:
    edited = Script.parse(yaml.safe_load(SCRIPT)).apply(model)
    factor = torch.ones(8, 8)
    factor[:4, 4:] = factor[4:, :4] = 0.25
    side = torch.arange(8) // 2
    factor[(side[:, None] + side) % 2 == 0] *= 0.5
    torch.testing.assert_close(look(edited), factor.flatten()[None, :, None] * look(model))
    check_valid(edited)


@pytest.mark.usefixtures("registered")
def test_scripts_round_trip_and_check_them() -> None:
    script = Script.parse(yaml.safe_load(SCRIPT))
    assert script.plain() == yaml.safe_load(SCRIPT)
    assert [step.name for step in script.steps] == ["dim", "dim"]
    for text, complaint in (
        ("- dim: {stops: 9}", "dim.stops is 9.0; expected 0.0 to 8.0"),
        ("- dam: {}", "unknown edit dam; did you mean dim"),
        ("- dim: {mask: {ches: {}}}", "unknown mask .*ches; did you mean chess"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            Script.parse(yaml.safe_load(text))


@pytest.mark.usefixtures("registered")
def test_edited_runs_hold_them(run: Path, tmp_path: Path) -> None:
    script = Script.parse(yaml.safe_load(SCRIPT))
    edited = edit_run(run, script, tmp_path / "out")
    assert Script.read(tmp_path / "out" / "edits.yaml") == script
    assert SPMM.load(tmp_path / "out").pack() == edited.pack()


@pytest.mark.usefixtures("registered")
def test_the_editor_takes_them(run: Path) -> None:
    session = Session.open(run)
    session.add("dim: {stops: 2, mask: {chess: {}}}")
    assert session.model().pack() == session.script.apply(session.original).pack()
    assert session.script.plain() == [{"dim": {"stops": 2.0, "mask": {"chess": {}}}}]


@pytest.mark.usefixtures("registered")
def test_the_help_describes_them(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["edit", "--list"])
    shown = capsys.readouterr().out
    for kind in (Dim, ChessMask):
        assert kind.__doc__ in shown
    for text in ("halvings of the light", "texels along each side of a square"):
        assert text in shown
