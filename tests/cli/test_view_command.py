"""`spmm view` from a run to pictures and pages, and everything that it refuses."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch.cli.main import main
from spmm_torch.errors import ConfigError
from spmm_torch.viz.palette import PAGE, series_colour
from spmm_torch.viz.requirements import use_offscreen


@pytest.fixture
def drawing() -> None:
    """Skips where nothing can be drawn."""
    pytest.importorskip("pyvista")
    pytest.importorskip("trame_vtk")
    try:
        use_offscreen("the test")
    except ConfigError as error:
        pytest.skip(str(error))


def page_share(codes: np.ndarray) -> float:
    """The part of a picture that shows nothing but the page."""
    page = np.round(255.0 * np.array(PAGE))
    return float((np.abs(codes - page).max(-1) <= 2.0).mean())


def shows(codes: np.ndarray, colour: tuple[float, float, float]) -> bool:
    """Whether a patch of about this hue is in the picture, shaded or not."""
    flat = codes.reshape(-1, 3).astype(float)
    unit = flat / np.linalg.norm(flat, axis=1, keepdims=True).clip(1.0)
    aim = np.array(colour) / np.linalg.norm(colour)
    return int((unit @ aim > 0.999).sum()) > 50


@pytest.mark.parametrize("what", [["--texel", "5,2"], ["--mosaic", "3"], ["--maps"]])
def test_a_picture_is_not_empty(
    what: list[str], run: Path, tmp_path: Path, drawing: None, capfd: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "x.png"
    assert main(["view", str(run), *what, "--save", str(target)]) == 0
    shown = capfd.readouterr()
    assert shown.out == f"{target}\n"
    assert shown.err == ""
    codes = np.asarray(Image.open(target))
    assert codes.shape[1:] == (1280, 3)
    assert 0.3 < page_share(codes) < 0.98


def test_lobes_have_their_colours(run: Path, tmp_path: Path, drawing: None) -> None:
    target = tmp_path / "x.png"
    assert main(["view", str(run), "--texel", "5,2", "--save", str(target)]) == 0
    codes = np.asarray(Image.open(target))
    assert all(shows(codes, series_colour(number)) for number in range(3))


def test_a_page_needs_no_network(run: Path, tmp_path: Path, drawing: None) -> None:
    target = tmp_path / "x.html"
    assert main(["view", str(run), "--html", str(target)]) == 0
    page = target.read_text(encoding="utf-8")
    assert "Texel 4, 4 of planted" in page
    assert "weight" in page
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", page)
    assert "kitware.github.io/vtk-js/icon" not in page


REFUSED = [
    (["--texel", "99,0", "--save", "x.png"], "--texel 99,0 lies outside of the texture"),
    (["--texel", "a", "--save", "x.png"], "argument --texel: 'a' is no texel; expected X,Y"),
    (["--view", "90,0", "--save", "x.png"], "argument --view: '90,0' is no view; expected THETA"),
    (["--view", "x", "--save", "x.png"], "argument --view: 'x' is no view; expected THETA,PHI"),
    (["--mosaic", "0", "--save", "x.png"], "--mosaic is 0; expected 1 to 32"),
    (["--save", "x.jpg"], "--save is x.jpg; expected a name that ends in .png"),
    (["--html", "x.htm"], "--html is x.htm; expected a name that ends in .html"),
    (["--against", "no.zip", "--save", "x.png"], "no.zip does not exist"),
]


@pytest.mark.parametrize(("options", "complaint"), REFUSED)
def test_bad_input_is_one_sentence(
    options: list[str],
    complaint: str,
    run: Path,
    tmp_path: Path,
    drawing: None,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert refused("view", run, *options).startswith(complaint)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_run_that_is_not_there(
    tmp_path: Path, drawing: None, refused: Callable[..., str]
) -> None:
    assert "does not exist; expected a run folder" in refused(
        "view", tmp_path / "no", "--save", tmp_path / "x.png"
    )


def test_without_pyvista_the_sentence_names_the_extra(
    run: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spmm_torch.viz.requirements.find_spec", lambda name: None)
    assert "needs pyvista, which is not installed" in refused("view", run, "--save", "x.png")
