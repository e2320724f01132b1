"""The page of the editor, without a browser."""

from __future__ import annotations

from pathlib import Path
from queue import Queue
from typing import Any

import pytest
import torch

from spmm_torch.viz.editor.lobe_cache import Stopped
from spmm_torch.viz.editor.session import Session


@pytest.fixture
def app(run: Path, tmp_path: Path) -> Any:
    """The editor of a run; `Any`, because it is imported where its packages are."""
    for package in ("trame", "trame_vuetify"):
        pytest.importorskip(package)
    from spmm_torch.viz.editor.app import EditorApp

    return EditorApp(Session.open(run, torch.device("cpu")), tmp_path, size=64)


def test_a_browser_is_opened_without_advice_of_others(
    app: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: Queue[str] = Queue()
    monkeypatch.setattr("webbrowser.open", opened.put)
    monkeypatch.setattr(app, "_start_worker", lambda **_: None)
    app.server.controller.on_server_ready.clear()

    def start(**options: Any) -> None:
        assert not options["open_browser"]  # trame tells then of options that are none of ours
        app.server.controller.on_server_ready()

    monkeypatch.setattr(app.server, "start", start)
    app.run("localhost", 4321, open_browser=True)
    assert opened.get(timeout=60.0) == "http://localhost:4321/"
    assert capsys.readouterr().out == ""


def test_no_picture_outlasts_the_server(app: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(**_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app.server, "start", stopped)
    with pytest.raises(KeyboardInterrupt):
        app.run("localhost", 0, open_browser=False)
    with pytest.raises(Stopped):
        app._finish()
