"""The editor in the browser: `spmm edit RUN --interactive`."""

from __future__ import annotations

import argparse
import errno
import os
import socket
import tempfile
from pathlib import Path

from spmm_torch.config.editor import EditorSettings
from spmm_torch.errors import ConfigError

from .inputs import check_run
from .parser import Group, print_lines
from .settings import add_settings, read_settings

COMMAND = "spmm edit --interactive"


def add_options(parser: Group) -> None:
    """The options of the editor, beside those that it shares with `spmm edit`."""
    parser.add_argument(
        "--interactive",
        action="store_true",
        help="open the editor; takes no SCRIPT, and -o names the folder that Save makes",
    )
    add_settings(parser, EditorSettings)
    parser.add_argument(
        "--no-browser", action="store_true", help="tell the address, and open no browser"
    )


def run(options: argparse.Namespace) -> list[str]:
    """Opens the session and serves its page until the process is stopped.

    Raises:
        SPMMError: bad input, or a package is missing.
    """
    check_run(options.run)
    from spmm_torch.runtime.device import resolve_device
    from spmm_torch.viz.editor.session import Session
    from spmm_torch.viz.requirements import require_packages

    settings = read_settings(EditorSettings, options)
    require_packages(COMMAND, "trame", "trame_vuetify")
    port = free_port(settings.host, settings.port)
    session = Session.open(options.run, resolve_device(options.device))
    from spmm_torch.viz.editor.app import EditorApp

    leave_a_core()
    with tempfile.TemporaryDirectory(prefix="spmm_edit_") as folder:
        app = EditorApp(session, Path(folder), options.output or "", settings.size)
        address = f"http://{settings.host}:{port}/"
        print_lines([f"The editor is at {address} ; stop it with Ctrl+C."])
        try:
            app.run(settings.host, port, not options.no_browser)
        except KeyboardInterrupt:
            print_lines([""])  # the way to end it
    return []


def free_port(host: str, port: int = 0) -> int:
    """A port that nothing listens at: `port`, or any for 0.

    Raises:
        ConfigError: the host is none of this machine, or something listens at `port`.
    """
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # left by an earlier editor
            probe.bind((host, port))
            return probe.getsockname()[1]
    except OSError as error:
        if port and error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise ConfigError(
                f"--port {port} cannot be used ({error}); expected a free one; leave --port out."
            ) from error
        raise ConfigError(f"--host {host} cannot be used ({error}); expected localhost.") from error


def leave_a_core() -> None:
    """Leaves a core to the browser: threads that wait for a busy core cost more than they give."""
    import torch

    torch.set_num_threads(max(1, (os.cpu_count() or 1) - 1))
