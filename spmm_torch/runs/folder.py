"""A run folder: written whole or not at all, and resumable."""

from __future__ import annotations

import errno
import json
import os
import shutil
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import Timeout

from ..config.fit import FitConfig
from ..data import BTF
from ..errors import ConfigError, OutputError
from ..model.spmm import SPMM
from ..report import Report, write_html, write_report
from ..report.views import Gallery
from ..runtime.atomic import write_atomic
from ..runtime.lock import locked
from ..runtime.ranks import ALONE, Ranks
from ..runtime.tensor_file import MODEL_FILE
from .fingerprint import RELEASE, difference

CONFIG, LOG, REPORT_PAGE = "config.yaml", "log.txt", "report.html"
# In the folder while it is made: finished stages, the settings they depend on, and a lock.
STATE, FINGERPRINT, LOCK = "state", "fingerprint.json", "lock"


def is_finished(path: Path | str) -> bool:
    """Whether a run folder is whole."""
    return (Path(path) / MODEL_FILE).is_file()


def unfinished(path: Path | str) -> Path:
    """The folder in which a run is made, beside the name that it gets at the end."""
    return Path(path).parent / f".{Path(path).name}.part"


@contextmanager
def new_run(
    path: Path | str,
    depends_on: dict[str, Any] | None = None,
    resume: bool = False,
    ranks: Ranks = ALONE,
    say: Callable[[str], object] = warnings.warn,
) -> Iterator[Path]:
    """A folder `.NAME.part` beside `path`, renamed to `path` at the end.

    After an error the folder is removed, unless it holds finished stages: then it stays for a
    later call with `resume`.

    Args:
        path: of the run.
        depends_on: values that the finished stages depend on, as JSON; an unfinished run with
            other values is not resumed. One of another release begins anew.
        resume: resume the unfinished run, if there is one.
        ranks: the processes of the run; the first one makes the folder.
        say: told in one line of what is not as it should be and does not stop the run.

    Raises:
        OutputError: `path` exists or cannot be written, or is unfinished and `resume` is False.
        ConfigError: the unfinished run has other values of `depends_on`.
    """
    target = Path(path)
    folder = unfinished(target)
    with ExitStack() as held:
        ranks.first(lambda: _begin(held, target, folder, depends_on, resume, say))
        try:
            yield folder
            if ranks.is_first:
                os.replace(folder, target)
                remove_leftovers(target)
        except OSError as error:
            raise _unwritable(target, error) from error


def _begin(
    held: ExitStack,
    target: Path,
    folder: Path,
    depends_on: dict[str, Any] | None,
    resume: bool,
    say: Callable[[str], object],
) -> None:
    """Makes the folder, or takes over an unfinished one, and locks it for this process."""
    try:
        _check_free(target)
        held.callback(_remove_empty, [parent for parent in target.parents if not parent.exists()])
        folder.mkdir(parents=True, exist_ok=True)
        _hold(held, folder, target, say)
        held.callback(_remove_worthless, folder)
        _check_free(target)  # the process that held the lock may have finished it
        if _has_state(folder):
            _check_unfinished(target, folder, depends_on, resume, say)
        (folder / STATE).mkdir(exist_ok=True)
        content = json.dumps(depends_on).encode()
        write_atomic(folder / FINGERPRINT, content)
    except OSError as error:
        raise _unwritable(target, error) from error


def _check_free(target: Path) -> None:
    if target.exists() or target.is_symlink():
        raise OutputError(
            f"run folder {target} exists; expected a new name; choose one or remove it."
        )


def _hold(held: ExitStack, folder: Path, target: Path, say: Callable[[str], object]) -> None:
    """Locks the folder; one that no process can lock is removed, if it holds nothing."""
    try:
        held.enter_context(locked(folder / LOCK, wait=False, say=say))
    except Timeout as error:
        raise OutputError(
            f"another process is making the run {target}; wait for it, or choose another name."
        ) from error
    except OSError:
        _remove_worthless(folder)
        raise


def _has_state(folder: Path) -> bool:
    return any((folder / STATE).glob("*.safetensors"))


def _check_unfinished(
    target: Path,
    folder: Path,
    depends_on: dict[str, Any] | None,
    resume: bool,
    say: Callable[[str], object],
) -> None:
    """Checks that an unfinished run may be resumed; of another release, nothing of it is kept.

    Each finished stage has the key of what it depends on: where no fingerprint can be read, these
    tell which of them serve.
    """
    if not resume:
        raise OutputError(
            f"an unfinished run of {target} lies in {folder}; add --resume to go on with it, or "
            f"remove that folder."
        )
    before, now = _kept_facts(folder / FINGERPRINT), json.loads(json.dumps(depends_on))
    if before is None:
        say(f"{folder / FINGERPRINT} cannot be read; stages of other settings are made anew")
    elif any(before.get(key) != (now or {}).get(key) for key in RELEASE):
        shutil.rmtree(folder / STATE)
        say(f"the stages in {folder} are those of another release; they are made anew")
    elif before != (now or {}):
        raise ConfigError(
            f"the unfinished run of {target} has {difference(before, now or {})}; repeat its "
            f"command to go on, or remove {folder}."
        )


def _kept_facts(path: Path) -> dict[str, Any] | None:
    """The fingerprint of an unfinished run; None if it cannot be read."""
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return facts if isinstance(facts, dict) else None


def remove_leftovers(run: Path | str) -> None:
    """Removes files from a finished run that only its making needed.

    They are removed after the run has its name, so that a kill before loses nothing. The
    fingerprint goes last, because it marks a run with leftovers.
    """
    if not (Path(run) / FINGERPRINT).is_file():
        return
    shutil.rmtree(Path(run) / STATE, ignore_errors=True)
    with suppress(OSError):
        for name in (LOCK, FINGERPRINT):
            (Path(run) / name).unlink(missing_ok=True)


def _remove_worthless(folder: Path) -> None:
    """Removes an unfinished run without a finished stage."""
    if not _has_state(folder):
        shutil.rmtree(folder, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    with suppress(OSError):  # folders that hold the run are not empty and stay
        for folder in folders:
            folder.rmdir()


def _unwritable(path: Path | str, error: OSError) -> OutputError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return OutputError(
            f"the disk is full at run folder {path} ({error}); free some space and go on with "
            f"--resume."
        )
    return OutputError(
        f"run folder {path} cannot be written ({error}); check the disk and the permissions."
    )


def write_run(
    folder: Path,
    model: SPMM,
    report: Report,
    config: FitConfig,
    btf: BTF,
    sections: Sequence[Gallery] = (),
) -> None:
    """Writes model, settings and both reports into `folder`; the page opens with `sections`."""
    write_atomic(folder / MODEL_FILE, model.pack())
    (folder / CONFIG).write_text(config.to_yaml(), encoding="utf-8")
    write_report(folder, report)
    write_html(folder / REPORT_PAGE, report.to_dict(), model, btf, sections)
