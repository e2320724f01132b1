"""A run and what it was fitted to, for the commands that compare the two."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from spmm_torch.config.fit import FitConfig

from .inputs import check_input, check_run, decode
from .parser import Group, add_against, add_cache
from .settings import add_settings

if TYPE_CHECKING:
    from spmm_torch.evaluate import Source
    from spmm_torch.runtime.progress import Progress


def add_source_options(parser: Group) -> None:
    """The options that tell where the input of a run is, and how it is read."""
    add_against(parser)
    add_settings(parser, FitConfig, "device")
    add_cache(parser)


def check_source(options: argparse.Namespace) -> None:
    """Checks that there may be a run and, where one is given, its input.

    Raises:
        SPMMError: one of them does not exist.
    """
    check_run(options.run)
    if options.against is not None:
        check_input(options.against)


def load_source(options: argparse.Namespace, progress: Progress) -> Source:
    """The run and its input, decoded.

    Raises:
        SPMMError: no run, or not its input.
    """
    from spmm_torch.evaluate import open_source
    from spmm_torch.runtime.device import resolve_device

    device = resolve_device(options.device)
    source = open_source(options.run, options.against, device, options.pattern)
    decode(source.btf, progress, options.cache)
    return source
