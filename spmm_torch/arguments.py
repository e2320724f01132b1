"""Command lines that complain like everything else here: in one sentence."""

from __future__ import annotations

import argparse
from typing import NoReturn

from .errors import ConfigError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises what it does not accept."""

    def error(self, message: str) -> NoReturn:
        """Raises the complaint.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"{message}; {self.prog} --help tells what is expected.")
