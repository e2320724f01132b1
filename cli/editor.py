"""The command `spmm edit RUN --interactive`."""

from __future__ import annotations

import argparse
import os
import socket
import sys
import tempfile
from pathlib import Path

import torch

from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.runtime.device import resolve_device
from spmm_torch.viz.editor.preview import SIZE
from spmm_torch.viz.editor.session import Session
from spmm_torch.viz.requirements import require_packages

COMMAND = "spmm edit --interactive"
MIN_SIZE, MAX_SIZE = 64, 1024


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm edit RUN --interactive`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        edit(options)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print()
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm edit RUN --interactive`."""
    result = argparse.ArgumentParser(
        prog="spmm edit", description="Edit the model of a run in the browser."
    )
    add = result.add_argument
    add("run", metavar="RUN", help="run folder or model file")
    add("--interactive", action="store_true", help="open the editor in a browser")
    add("-o", "--output", default="", metavar="RUN2", help="folder that Save makes")
    add("--size", type=int, default=SIZE, help=f"pixels of the pictures (default {SIZE})")
    add("--host", default="localhost", help="address to listen at (default localhost)")
    add("--port", type=int, default=0, help="port to listen at (default: any free one)")
    add("--no-browser", action="store_true", help="do not open a browser, only tell the address")
    add("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    return result


def edit(options: argparse.Namespace) -> None:
    """Opens the session and serves its page until the process is stopped.

    Raises:
        SPMMError: bad input, or a package is missing.
    """
    if not MIN_SIZE <= options.size <= MAX_SIZE:
        raise ConfigError(f"--size is {options.size}; expected {MIN_SIZE} to {MAX_SIZE} pixels.")
    require_packages(COMMAND, "trame", "trame_vuetify")
    port = options.port or free_port(options.host)
    session = Session.open(options.run, resolve_device(options.device))
    from spmm_torch.viz.editor.app import EditorApp

    leave_a_core()
    with tempfile.TemporaryDirectory(prefix="spmm_edit_") as folder:
        app = EditorApp(session, Path(folder), options.output, options.size)
        print(f"The editor is at http://{options.host}:{port}/ ; stop it with Ctrl+C.", flush=True)
        app.run(options.host, port, not options.no_browser)


def free_port(host: str) -> int:
    """A port that nothing listens at.

    Raises:
        ConfigError: the host is none of this machine.
    """
    try:
        with socket.socket() as probe:
            probe.bind((host, 0))
            return probe.getsockname()[1]
    except OSError as error:
        raise ConfigError(f"--host {host} cannot be used ({error}); expected localhost.") from error


def leave_a_core() -> None:
    """Leaves a core to the browser: threads that wait for a busy core cost more than they give."""
    torch.set_num_threads(max(1, (os.cpu_count() or 1) - 1))
