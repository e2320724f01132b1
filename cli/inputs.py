"""BTFs and runs as commands read them, and what can be told of them at once.

Torch takes seconds to import: what is wrong with a name is found before that.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spmm_torch.config.fit import DataConfig, FitConfig
from spmm_torch.config.shipped import settings_of
from spmm_torch.errors import DataError, OutputError
from spmm_torch.runtime.foreign import absence

from .parser import Group, file_name
from .settings import add_settings

if TYPE_CHECKING:
    from spmm_torch.data import BTF
    from spmm_torch.runtime.progress import Progress


FORMATS = "a zip or folder of pictures, an UBO2014 .btf, or an NPZ"
MODEL_SUFFIX = ".safetensors"
# Settings of a fit that tell how files are read, whatever is done with them.
READING = ("gamma", "cosine", "negative", "missing", "pattern", "rings")


def check_input(path: str) -> None:
    """Checks that there is something at the path of a BTF.

    Raises:
        DataError: there is nothing.
    """
    if (reason := absence(path)) is not None:
        raise DataError(f"{path} {reason}; expected {FORMATS}; check the path.")


def check_run(path: str, hint: str = "fit it by spmm fit first") -> None:
    """Checks that a path may be that of a run folder or model file.

    Args:
        path: of the run.
        hint: what to do where it is another file, such as a BTF.

    Raises:
        OutputError: there is nothing, or a file of another kind.
    """
    place = Path(path)
    if (reason := absence(path)) is not None:
        raise OutputError(
            f"{path} {reason}; expected a run folder made by spmm fit; check the path."
        )
    if place.is_file() and place.suffix.lower() != MODEL_SUFFIX:
        raise OutputError(f"{path} is neither a run folder nor a {MODEL_SUFFIX} file; {hint}.")


def check_place(path: str, *, replaces: bool = False) -> None:
    """Checks that an output can be made, before work of minutes is done for it.

    Args:
        path: of the output.
        replaces: whether a file of that name is replaced.

    Raises:
        OutputError: there is something already, or no folder to write into.
    """
    target = Path(path)
    folder = target.parent
    if target.is_dir() or (not replaces and (target.exists() or target.is_symlink())):
        raise OutputError(f"{path} exists; expected a new name; choose one or remove it.")
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        reason = "is not writable" if folder.is_dir() else "is no folder"
        raise OutputError(f"{path} cannot be written ({folder} {reason}); choose another place.")


def add_reading(parser: Group, default: str = "the values of spmm fit --help") -> None:
    """The options --config, --set and --pattern: how a BTF is read, in the words of a fit."""
    parser.add_argument(
        "--config",
        type=file_name,
        metavar="YAML",
        help=f"settings file, as of spmm fit, or the name of one that ships (default: {default})",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="value of one setting, such as data.gamma=1.0 or data.cosine=missing; may be repeated",
    )
    add_settings(parser, DataConfig, "pattern")


def reading(options: argparse.Namespace, default: FitConfig | None = None) -> FitConfig:
    """The settings of --config, else `default`, else those that ship, changed by --set.

    Raises:
        ConfigError: a file that cannot be read, an unknown key, or a value out of its range.
    """
    given = settings_of(options.config) if options.config else default or FitConfig()
    found = given.override(options.set)
    if options.pattern is None:
        return found
    return replace(found, data=replace(found.data, pattern=options.pattern))


def decode(btf: BTF, progress: Progress, cache: str | None = None) -> None:
    """Decodes a BTF, in memory if it fits there.

    Args:
        btf: the BTF.
        progress: told how far it is.
        cache: folder that keeps the decoded values; the user's own if None.

    Raises:
        DataError: a picture cannot be decoded, or a value is not valid.
        OutputError: the cache cannot be written.
    """
    from spmm_torch.data.scattered_btf import ScatteredBTF
    from spmm_torch.runtime.memory import DEFAULT_FRACTION, free_memory

    for note in btf.notes:
        progress.say(note)
    folder = None if cache is None else Path(cache)
    if isinstance(btf, ScatteredBTF):  # in memory already
        btf.load()
        return
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_FRACTION * free_memory()), cache=folder)
