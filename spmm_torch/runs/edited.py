"""The run folder of an edited model: self-contained, with the script of its edits."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import torch

from ..config.written import dump_text
from ..edit import Script
from ..edit.parsing import map_paths
from ..errors import OutputError, SPMMError
from ..model.spmm import SPMM
from ..report import write_report
from ..report.contract import FILE_NAME, Report, older_report
from ..report.edited import edited_report, write_edited_html
from ..runtime.atomic import new_folder, write_atomic
from ..runtime.tensor_file import MODEL_FILE
from .folder import CONFIG, REPORT_PAGE

EDITS, MASKS, ORIGINAL = "edits.yaml", "masks", "original.txt"


@dataclass(frozen=True)
class Edited:
    """An edited run, taken apart.

    Attributes:
        run: the run that its edits begin with.
        original: the model of that run.
        script: the edits.
    """

    run: Path
    original: SPMM
    script: Script


def taken_apart(run: Path | str, model: SPMM, device: torch.device | str = "cpu") -> Edited | None:
    """The edits of a run and what they began with; None where they do not lead to its `model`.

    So it is where nothing was edited, or the original is gone or is another one by now.

    Args:
        run: folder or model file.
        model: its model.
        device: of the edits.
    """
    source = _folder(run)
    original = _original(source)
    if original is None or not (source / EDITS).is_file():
        return None
    try:
        script = Script.read(source / EDITS)
        before = SPMM.load(original, device).requires_grad_(False)
        same = script.apply(before).pack() == model.pack()
    except SPMMError:
        return None
    return Edited(original, before, script) if same else None


def edit_run(
    run: Path | str, script: Script, output: Path | str, device: torch.device | str = "cpu"
) -> SPMM:
    """Edits the model of a run and saves the result as another run.

    Args:
        run: folder or model file.
        script: the edits.
        output: the folder to make.
        device: of the edits.

    Raises:
        SPMMError: the run cannot be read, an edit cannot be done, or `output` cannot be written.
    """
    before = SPMM.load(run, device)
    after = script.apply(before)
    save_edited_run(run, before, after, script, output)
    return after


def save_edited_run(
    run: Path | str, before: SPMM, after: SPMM, script: Script, output: Path | str
) -> None:
    """Writes the run folder of an edited model, whole or not at all.

    It holds the model, the settings of the fit, `edits.yaml`, the pictures of its masks, the path
    of the run they begin with, and reports in which errors of the fit are unknown. If `run` is an
    edited run, `edits.yaml` begins with the edits of `run`, so that it leads from the fit to this
    model.

    Args:
        run: folder or model file that was edited.
        before: its model.
        after: the edited model.
        script: the edits that lead from `before` to `after`.
        output: the folder to make.

    Raises:
        OutputError: `output` exists or cannot be written, or the report of `run` is damaged.
    """
    source = _folder(run)
    report = _report(source / FILE_NAME)
    history = Script.read(source / EDITS) if (source / EDITS).is_file() else Script()
    with new_folder(output) as folder:
        write_atomic(folder / MODEL_FILE, after.pack())
        if (source / CONFIG).is_file():
            shutil.copyfile(source / CONFIG, folder / CONFIG)
        text = _kept_script(history + script, folder)
        (folder / EDITS).write_text(text, encoding="utf-8")
        original = _original(source) if (source / EDITS).is_file() else source
        if original is not None:
            name = os.path.relpath(original.resolve(), Path(output).resolve())
            (folder / ORIGINAL).write_bytes(os.fsencode(f"{Path(name).as_posix()}\n"))
        if report is not None:
            write_report(folder, edited_report(report, after))
        write_edited_html(folder / REPORT_PAGE, before, after, text)


def _folder(run: Path | str) -> Path:
    """The folder of a run, which may be named by the model file in it."""
    return Path(run) if Path(run).is_dir() else Path(run).parent


def _original(folder: Path) -> Path | None:
    """The run that the edits of another one begin with; None where it is unknown or gone."""
    if not (folder / ORIGINAL).is_file():
        return None
    name = os.fsdecode((folder / ORIGINAL).read_bytes()).strip()
    original = (folder / name).resolve()
    return original if original.is_dir() else None


def _report(path: Path) -> Report | None:
    """The report of the run; None where there is none."""
    if not path.is_file():
        return None
    try:
        return older_report(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(
            f"{path} cannot be read ({error}); expected the report of a fit; restore or remove it."
        ) from error


def _kept_script(script: Script, folder: Path) -> str:
    """The script as YAML, with the pictures of its masks copied into `folder`."""
    kept: dict[str, str] = {}

    def keep(path: str) -> str:
        source = Path(path)
        if not source.is_file() or source.name == MODEL_FILE:
            return path  # the other model of a blend stays where it is
        if path not in kept:
            (folder / MASKS).mkdir(exist_ok=True)
            kept[path] = f"{MASKS}/{len(kept) + 1}_{source.name}"
            shutil.copyfile(source, folder / kept[path])
        return kept[path]

    return dump_text(map_paths(script.plain(), keep), unicode=True)
