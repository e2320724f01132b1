"""A run folder: made whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .config import FitConfig
from .data import BTF
from .errors import OutputError
from .model import SPMM
from .report import write_html, write_report
from .store import MODEL_FILE, write_atomic

CONFIG, LOG, REPORT_PAGE = "config.yaml", "log.txt", "report.html"


@contextmanager
def new_run(path: Path | str) -> Iterator[Path]:
    """A folder under a temporary name beside `path`, renamed to it at the end.

    If anything goes wrong it is removed, and nothing is left.

    Raises:
        OutputError: `path` exists, or cannot be written.
    """
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise OutputError(
            f"run folder {path} exists; expected a new name; choose one or remove it."
        )
    folder = target.with_name(f".{target.name}.{os.getpid()}.part")
    new_parents = [parent for parent in target.parents if not parent.exists()]  # innermost first
    try:
        folder.mkdir(parents=True)
        yield folder
        os.replace(folder, target)
    except OSError as error:
        raise OutputError(
            f"run folder {path} cannot be written ({error}); check the disk and the permissions."
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # they stay where they hold the run
            for parent in new_parents:
                parent.rmdir()


def write_run(
    folder: Path, model: SPMM, report: dict[str, Any], config: FitConfig, btf: BTF
) -> None:
    """Writes model, settings and both reports into `folder`."""
    write_atomic(folder / MODEL_FILE, model.pack())
    (folder / CONFIG).write_text(config.to_yaml(), encoding="utf-8")
    write_report(folder, report)
    write_html(folder / REPORT_PAGE, report, model, btf)
