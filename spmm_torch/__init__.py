"""Sparse parametric mixture models for measured bidirectional texture functions [WDR11]."""

from __future__ import annotations

from .config.fit import FitConfig
from .data import BTF, load_btf
from .errors import ConfigError, DataError, OutputError, SPMMError
from .model.spmm import SPMM

__version__ = "0.1.0"
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
