"""A session: sliders make scripts, undo and redo, and what is saved is what was shown."""

from __future__ import annotations

import errno
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.edit import Rectangle, Script
from spmm_torch.edit.edits.intensity import Intensity
from spmm_torch.edit.masks.cluster import ClusterMask
from spmm_torch.errors import ConfigError, OutputError
from spmm_torch.viz.editor import session as session_module
from spmm_torch.viz.editor.session import Session
from spmm_torch.viz.editor.sliders import NEUTRAL, RELIEF, SLIDERS, edits_of, values_of
from tests.planted.models import DIFFUSE, planted_model, with_relief


@pytest.fixture
def session(run: Path) -> Session:
    return Session.open(run)


def same(a: SPMM, b: SPMM) -> bool:
    """Whether two models are equal to the bit."""
    first, second = a.to_tensors()[0], b.to_tensors()[0]
    return first.keys() == second.keys() and all(
        first[name].shape == second[name].shape and torch.equal(first[name], second[name])
        for name in first
    )


def test_neutral_sliders_make_no_edit() -> None:
    assert edits_of({}) == []
    assert edits_of(NEUTRAL) == []


@pytest.mark.parametrize("slider", SLIDERS, ids=lambda slider: slider.name)
def test_every_slider_makes_one_edit_at_either_end(slider) -> None:  # noqa: ANN001
    assert slider.low < slider.neutral < slider.high or slider.neutral == slider.low
    for value in (slider.low, slider.high):
        assert len(edits_of({slider.name: value})) == 1


@pytest.mark.parametrize("slider", SLIDERS, ids=lambda slider: slider.name)
def test_every_slider_changes_a_model(slider, session: Session) -> None:  # noqa: ANN001
    if slider.name == RELIEF:
        session = Session(session.run, with_relief(session.original))
    session.move(slider.name, 0.5 * (slider.neutral + slider.high))
    assert not same(session.model(), session.original)


def test_a_drag_is_undone_at_once(session: Session) -> None:
    for value in (1.2, 1.5, 2.0):
        session.move("intensity", value)
    session.release()
    session.move("intensity", 2.5)
    assert session.values["intensity"] == 2.5
    session.undo()
    assert session.values["intensity"] == 2.0
    session.undo()
    assert session.values == NEUTRAL
    assert not session.can_undo
    assert same(session.model(), session.original)


def test_redo_follows_undo_until_something_else_is_done(session: Session) -> None:
    session.move("hue", 40.0)
    before = session.model()
    session.undo()
    session.redo()
    assert same(session.model(), before)
    session.undo()
    session.move("intensity", 2.0)
    assert not session.can_redo


def test_undo_of_nothing_is_nothing(session: Session) -> None:
    session.undo()
    session.redo()
    assert session.script == Script()


def test_moving_back_to_neutral_leaves_no_edit(session: Session) -> None:
    session.move("intensity", 2.0)
    session.move("intensity", 1.0)
    assert session.script == Script()


def test_edits_stay_where_they_were_made(session: Session) -> None:
    left = Rectangle(0, 0, 4, 8)
    session.select(left)
    session.move("intensity", 2.0)
    session.select(None)
    assert session.values == NEUTRAL
    session.move("saturation", 0.5)
    assert [step.mask for step in session.script.steps] == [left, None]
    session.undo()
    gain = session.model().weight / session.original.weight
    texel = torch.repeat_interleave(session.original.lobe_count_per_texel())
    assert torch.allclose(gain[texel % 8 < 4], torch.tensor(2.0))
    assert torch.allclose(gain[texel % 8 >= 4], torch.tensor(1.0))


def test_a_selection_without_edits_leaves_no_layer(session: Session) -> None:
    session.select(ClusterMask((0,)))
    session.select(ClusterMask((1,)))
    assert len(session.layers) == 1
    assert session.mask == ClusterMask((1,))


def test_typed_edits_act_in_the_selection(session: Session) -> None:
    session.select(ClusterMask((1,)))
    session.add("intensity: {factor: 3}")
    (step,) = session.script.steps
    assert step.mask == ClusterMask((1,))
    session.add(
        "[{intensity: {factor: 2, mask: {cluster: {number: 0}}}}, {spread_normals: {factor: 2}}]"
    )
    assert [step.name for step in session.script.steps] == [
        "intensity",
        "intensity",
        "spread_normals",
    ]
    session.reset()
    assert session.script == Script()
    session.undo()
    assert len(session.script.steps) == 3


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("intensty: {factor: 2}", "did you mean intensity"),
        ("intensity: {factor: -1}", "factor"),
        ("intensity: {", "not valid YAML"),
        ("7", "expected one edit"),
        ("intensity: {factor: 2, mask: {cluster: {number: 9}}}", "cluster"),
    ],
)
def test_a_wrong_text_changes_nothing(session: Session, text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        session.add(text)
    assert session.script == Script()
    assert not session.can_undo


def test_what_no_slider_allows_is_refused(session: Session) -> None:
    with pytest.raises(ConfigError, match="unknown slider tint; expected one of intensity"):
        session.move("tint", 1.0)
    with pytest.raises(ConfigError, match="intensity is 99; expected a value from 0 to 3"):
        session.move("intensity", 99)


def test_the_model_is_that_of_the_script(session: Session) -> None:
    session.move("width", 0.6)
    session.move("hue", 60.0)
    session.move("normals", 1.5)
    session.move("normals", 1.6)
    assert same(session.model(), session.script.apply(session.original))


def test_saved_runs_are_what_was_shown(session: Session, tmp_path: Path) -> None:
    session.select(Rectangle(2, 2, 3, 3))
    session.move("hue", -100.0)
    session.save(tmp_path / "run2")
    assert same(SPMM.load(tmp_path / "run2"), session.model())
    again = Script.read(tmp_path / "run2" / "edits.yaml")
    assert same(again.apply(session.original), session.model())
    with pytest.raises(ConfigError, match="no name to save as"):
        session.save(" ")


def test_saved_again_replaces_what_this_session_saved(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for value in (-100.0, 60.0):
        session.move("hue", value)
        session.save("~/run2")
        assert same(SPMM.load(tmp_path / "run2"), session.model())
    with pytest.raises(OutputError, match="exists"):  # nor of another session
        Session.open(session.run).save(tmp_path / "run2")
    (tmp_path / "mine").mkdir()
    with pytest.raises(OutputError, match="exists"):
        session.save(tmp_path / "mine")
    assert not list(tmp_path.glob(".*"))


def test_an_earlier_save_that_cannot_go_is_told(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    session.save(tmp_path / "run2")
    monkeypatch.setattr(session_module, "shutil", SimpleNamespace(rmtree=fail))
    with pytest.raises(OutputError, match=r"run2 cannot be written .*; choose another place"):
        session.save(tmp_path / "run2")


def test_sliders_without_lobes_are_not_usable(session: Session) -> None:
    assert [name for name, usable in session.usable().items() if not usable] == ["relief"]
    matte = Session(session.run, planted_model(names=DIFFUSE).requires_grad_(False))
    usable = matte.usable()
    assert not usable["specular"]
    assert not usable["width"]
    assert usable["diffuse"]
    assert usable["hue"]


def test_edits_of_a_saved_run_can_be_moved_and_undone(session: Session, tmp_path: Path) -> None:
    """Sliders stand where they stood, also over edits that no slider stands for."""
    session.move("hue", 60.0)
    session.move("width", 0.6)
    session.add("replace_model: {name: ward}")
    session.select(Rectangle(2, 2, 3, 3))
    session.move("intensity", 2.0)
    session.move("saturation", 0.5)
    session.save(tmp_path / "edited")

    again = Session.open(tmp_path / "edited")
    assert again.run == session.run.resolve()
    assert again.values == session.values
    assert again.mask == session.mask
    assert again.script == session.script
    assert same(again.model(), session.model())
    again.move("intensity", 1.0)
    session.move("intensity", 1.0)
    again.save(tmp_path / "edited2")
    assert Script.read(tmp_path / "edited2" / "edits.yaml") == session.script
    for _ in range(2):
        again.undo()
    assert again.values == NEUTRAL | {"hue": 60.0, "width": 0.6}
    again.undo()
    assert same(again.model(), session.original)
    assert not again.can_undo


@pytest.mark.parametrize("change", ["gone", "another", "unknown", "damaged"])
def test_a_run_whose_original_is_not_there_is_edited_as_it_is(
    session: Session, tmp_path: Path, change: str
) -> None:
    session.move("intensity", 2.0)
    session.save(tmp_path / "edited")
    if change == "gone":
        session.run.rename(tmp_path / "moved")
    elif change == "another":
        (session.run / "model.safetensors").write_bytes(planted_model(3).pack())
    elif change == "unknown":
        (tmp_path / "edited" / "original.txt").unlink()
    else:
        (tmp_path / "edited" / "edits.yaml").write_text("- intensity: {factor: 3}")
    again = Session.open(tmp_path / "edited")
    assert again.run == tmp_path / "edited"
    assert again.script == Script()
    assert same(again.model(), session.model())


def test_runs_and_originals_may_move_together(session: Session, tmp_path: Path) -> None:
    session.move("intensity", 2.0)
    session.save(tmp_path / "edited")
    (tmp_path / "elsewhere").mkdir()
    for name in ("run", "edited"):
        (tmp_path / name).rename(tmp_path / "elsewhere" / name)
    assert Session.open(tmp_path / "elsewhere" / "edited").values["intensity"] == 2.0


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"intensity": 2.0},
        {"hue": 40.0, "saturation": 0.5, "specular_hue": -20.0},
        {slider.name: slider.high for slider in SLIDERS},
    ],
)
def test_sliders_are_told_from_their_edits(values: dict[str, float]) -> None:
    edits = edits_of(values)
    assert NEUTRAL | (values_of(edits) or {}) == NEUTRAL | values
    if edits:
        assert values_of(edits * 2) is None  # no slider does anything twice
        assert values_of([*edits, Intensity(factor=99.0)]) is None  # nor beyond its range
