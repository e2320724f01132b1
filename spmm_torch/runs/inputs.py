"""The input of a run, read again as its fit read it: the one way for everything that needs it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..config.fit import FitConfig
from ..config.written import read_yaml
from ..data import BTF, load_input
from ..errors import ConfigError, DataError, OutputError
from ..report.contract import FILE_NAME as REPORT_FILE
from ..runtime.names import path_of
from ..runtime.tensor_file import MODEL_FILE
from .fingerprint import RELEASE, contents_of, difference, differing_setting
from .folder import CONFIG

# How earlier releases read: settings in `data` that their runs do not state, as they had none.
EARLIER_READING = {"rows": "bottom"}


def read_input(
    run: Path | str,
    against: Path | str | None = None,
    pattern: str | None = None,
    *,
    all_directions: bool = False,
) -> BTF:
    """The input of a run, or the BTF `against`, under the settings of the run.

    Args:
        run: run folder, or the model file in it.
        against: BTF to read instead of the run's own input.
        pattern: how pictures are named; None: as in the run's settings.
        all_directions: whether to read directions too that the fit was not to see.

    Raises:
        ConfigError: the pattern is malformed.
        OutputError: the run names no input.
        DataError: the input does not exist, or is not valid.
    """
    path = Path(against) if against is not None else own_input(run)
    config = run_settings(run)
    settings = replace(config.data, pattern=pattern or config.data.pattern)
    if all_directions:
        settings = replace(settings, directions=None)
    return load_input(path, settings, config.seed)


def own_input(run: Path | str) -> Path:
    """The path of the input that a run names.

    Earlier runs name it relative to the folder in which `spmm fit` was called. That is one above
    the run, or the present one.

    Raises:
        OutputError: the run names no input, as that of an edited model does.
        DataError: there is none.
    """
    if (name := _named_input(run)) is None:
        raise OutputError(f"{run} names no input; expected a fit; give the input with --against.")
    named = Path(name)
    places = _places(run, named)
    for place in places:
        if place.exists():
            return place
    tried = "" if named.is_absolute() else f" in {', '.join(str(at) for at in _roots(run))}"
    raise DataError(
        f"the input of {run}, {named}, does not exist{tried}; expected it where it was when the "
        f"run was made; give its present path with --against."
    )


def _places(run: Path | str, named: Path) -> list[Path]:
    """Where the input that a run names may be, the likeliest first."""
    return [named] if named.is_absolute() else [root / named for root in _roots(run)]


def _roots(run: Path | str) -> list[Path]:
    """Folders that the path of an input may be relative to: those around its run, the present one.

    They come from the inside out, without the root, in which nobody works.
    """
    around = run_folder(run).absolute().parents
    return list(dict.fromkeys([*around[:-1], Path.cwd()]))


def run_settings(run: Path | str) -> FitConfig:
    """The settings of a run; the defaults where a model stands alone, without a run.

    A `.btf` is read as the fit read it, also by a run of a release before 0.2 (`EARLIER_READING`).

    Raises:
        ConfigError: the settings of the run are gone or not valid.
    """
    path = run_folder(run) / CONFIG
    if _named_input(run) is None and not path.is_file():
        return FitConfig()
    settings = FitConfig.from_yaml(path)
    return replace(settings, data=replace(settings.data, **_earlier_reading(path)))


def _earlier_reading(config: Path) -> dict[str, str]:
    """How an earlier release read, as far as the settings file `config` does not state it."""
    stated = read_yaml(config).get("data") or {}
    return {key: value for key, value in EARLIER_READING.items() if key not in stated}


def check_finished(run: Path | str, source: Path | str, config: FitConfig) -> None:
    """Checks that a finished run is the one that a command asks for, as far as the run can tell.

    Args:
        run: the finished run.
        source: the input of the command; its folder does not count, as both may have been moved.
        config: the settings of the command.

    Raises:
        ConfigError: the run has another input or other settings.
    """
    try:
        named, settings = _named_input(run), run_settings(run)
    except (ConfigError, OutputError):  # of another release
        return
    if Path(named or "").suffix.lower() != ".btf":  # no other format has rows that were read so
        now = {key: getattr(config.data, key) for key in _earlier_reading(run_folder(run) / CONFIG)}
        settings = replace(settings, data=replace(settings.data, **now))
    found = differing_setting(settings, config)
    if named is not None and Path(named).name != Path(source).absolute().name:
        found = f"the input {named}, not {source}"
    if found is not None:
        raise _finished_otherwise(run, found)


def check_contents(run: Path | str, facts: dict[str, Any]) -> None:
    """Checks that the input of a finished run, and other files that it read, are as they were.

    Runs of other releases, whose hashes may differ, and those made from Python are not checked.

    Args:
        run: the finished run.
        facts: the fingerprint of the fit that a command asks for.

    Raises:
        ConfigError: the content of one of them is another.
    """
    now = contents_of(facts)
    kept = read_report(run).get("contents")
    if not isinstance(kept, dict) or any(kept.get(key) != now[key] for key in RELEASE):
        return
    if kept != now:
        raise _finished_otherwise(run, difference(kept, now))


def _finished_otherwise(run: Path | str, found: str) -> ConfigError:
    """The error for a finished run that is not the one that a command asks for."""
    return ConfigError(
        f"the finished run {run} has {found}; expected the same; choose another name, or remove it "
        f"to fit anew."
    )


def has_input(run: Path | str) -> bool:
    """Whether the input of a run is still where it was when the run was made."""
    named = _named_input(run)
    return named is not None and any(place.exists() for place in _places(run, Path(named)))


def _named_input(run: Path | str) -> str | None:
    """The input in the report of a run; None if there is no report, or it is of an edited model."""
    has_report = (run_folder(run) / REPORT_FILE).is_file()
    named = read_report(run)["input"] if has_report else None
    return path_of(named) if named else None


def read_report(run: Path | str) -> dict[str, Any]:
    """The figures of a run.

    Raises:
        OutputError: the report does not exist, or is malformed.
    """
    path = run_folder(run) / REPORT_FILE
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OutputError(
            f"{path} cannot be read ({error}); expected the report of a run; give the folder that "
            f"spmm fit has made."
        ) from error
    if not isinstance(report, dict) or not isinstance(report.get("input", 0), str | None):
        raise OutputError(f"{path} names no input; expected the report of a run; fit it anew.")
    return report


def run_folder(run: Path | str) -> Path:
    """The folder of a run, which may be named by the model file in it."""
    path = Path(run)
    return path.parent if path.name == MODEL_FILE else path
