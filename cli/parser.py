"""Command lines that complain like everything else here: in one sentence."""

from __future__ import annotations

import argparse
from typing import NoReturn

from spmm_torch.errors import ConfigError

# Exit code of a command that Ctrl-C has ended, as shells give it.
STOPPED = 130


class Parser(argparse.ArgumentParser):
    """An argument parser that raises what it does not accept."""

    def error(self, message: str) -> NoReturn:
        """Raises the complaint.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"{message}; {self.prog} --help tells what is expected.")
