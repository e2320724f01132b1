"""Show or clear the cache of decoded BTFs.

It keeps, for later commands, those that did not fit in memory.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from spmm_torch.errors import ConfigError

from .parser import Parser, file_name


def add_options(parser: Parser) -> None:
    """The options of `spmm cache`."""
    parser.add_argument(
        "action",
        choices=("list", "clear"),
        help="list shows size, state and source of each BTF; clear removes all",
    )
    parser.add_argument(
        "--cache",
        type=file_name,
        metavar="FOLDER",
        help="folder of the cache (default: the user's cache folder)",
    )


def run(options: argparse.Namespace) -> list[str]:
    """Shows or clears the cache.

    Raises:
        ConfigError: --cache is no folder.
        OutputError: an entry cannot be removed.
    """
    if options.cache is not None and not Path(options.cache).is_dir():
        raise ConfigError(
            f"--cache {options.cache} is no folder; expected that of a cache; check the path."
        )
    from spmm_torch.data.cache import clear, default_folder, entries

    folder = Path(options.cache) if options.cache else default_folder()
    if options.action == "list":
        kept = entries(folder)
        lines = [f"{size / 1e9:7.2f} GB  {state:<10} {source}" for size, source, state in kept]
        return lines or [f"{folder} keeps no BTF"]
    count, freed = clear(folder)
    return [f"{folder}: {count} files removed, {freed / 1e9:.2f} GB freed"]
