"""The command `spmm cache`: what decoded BTFs take on disk, and how to be rid of them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from spmm_torch.data.cache import clear, default_folder, entries
from spmm_torch.errors import SPMMError


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm cache`; returns the exit code."""
    options = parser().parse_args(arguments)
    folder = Path(options.cache) if options.cache else default_folder()
    if options.action == "list":
        for size, source, state in entries(folder):
            print(f"{size / 1e9:7.2f} GB  {state:<10} {source}")
        return 0
    try:
        count, freed = clear(folder)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{folder}: {count} files removed, {freed / 1e9:.2f} GB freed")
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm cache`."""
    result = argparse.ArgumentParser(
        prog="spmm cache",
        description="Decoded BTFs that did not fit in memory are kept for later runs.",
    )
    result.add_argument("action", choices=("list", "clear"))
    result.add_argument("--cache", metavar="FOLDER", help="default: the user's own cache folder")
    return result
