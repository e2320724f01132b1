"""`spmm edit --interactive` refuses bad input in one sentence, before a page is served."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from spmm_torch.cli import editor as command
from spmm_torch.errors import ConfigError


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--size", "5"], "--size is 5; expected 64 to 1024."),
        (["--host", "no.such.host.invalid"], "--host no.such.host.invalid cannot be used"),
        (["--device", "abacus"], "abacus"),
    ],
)
def test_bad_options(
    options: list[str], complaint: str, run: Path, refused: Callable[..., str]
) -> None:
    pytest.importorskip("trame_vuetify")
    assert complaint in refused("edit", run, "--interactive", *options)


def test_a_run_that_is_not_there(tmp_path: Path, refused: Callable[..., str]) -> None:
    pytest.importorskip("trame_vuetify")
    assert "does not exist; expected a run folder" in refused(
        "edit", tmp_path / "no", "--interactive"
    )


def test_without_trame_the_sentence_names_the_extra(
    run: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spmm_torch.viz.requirements.find_spec", lambda name: None)
    assert "needs trame, which is not installed" in refused("edit", run, "--interactive")


def test_a_free_port_is_one() -> None:
    assert 0 < command.free_port("localhost") < 1 << 16


def test_a_port_in_use_is_refused() -> None:
    with socket.socket() as taken:
        taken.bind(("localhost", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"--port {port} cannot be used"):
            command.free_port("localhost", port)
    assert command.free_port("localhost", port) == port
