"""Sparse parametric mixture models for measured bidirectional texture functions [WDR11].

What needs torch is imported when it is first asked for: help texts and settings do without.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .errors import ConfigError, DataError, OutputError, SPMMError
from .runtime.lazy import lazy_names

if TYPE_CHECKING:
    from .config.fit import FitConfig
    from .data import BTF, load_btf
    from .model.spmm import SPMM

__version__ = "0.2.0"
__all__ = [
    "BTF",
    "SPMM",
    "ConfigError",
    "DataError",
    "FitConfig",
    "OutputError",
    "SPMMError",
    "load_btf",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {"BTF": ".data", "FitConfig": ".config.fit", "SPMM": ".model.spmm", "load_btf": ".data"},
)
