"""BTFs as commands read them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from spmm_torch.config.fit import FitConfig

from .parser import Group, file_name

if TYPE_CHECKING:
    from spmm_torch.data import BTF
    from spmm_torch.runtime.progress import Progress


def add_reading(parser: Group, default: str = "the values of spmm fit --help") -> None:
    """The options --config and --set, which tell how a BTF is read in the words of a fit."""
    parser.add_argument(
        "--config",
        type=file_name,
        metavar="YAML",
        help=f"settings file, as of spmm fit (default: {default})",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="value of one setting, such as data.gamma=1.0 or data.cosine=missing; may be repeated",
    )


def reading(options: argparse.Namespace, default: FitConfig | None = None) -> FitConfig:
    """The settings of --config, else `default`, else those that ship, changed by --set.

    Raises:
        ConfigError: a file that cannot be read, an unknown key, or a value out of its range.
    """
    given = FitConfig.from_yaml(options.config) if options.config else default or FitConfig()
    return given.override(options.set)


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
    from spmm_torch.runtime.memory import DEFAULT_FRACTION, free_memory

    folder = None if cache is None else Path(cache)
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_FRACTION * free_memory()), cache=folder)
