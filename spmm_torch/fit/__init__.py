"""Fit a sparse parametric mixture model to a BTF [WDR11 §3.2, §4.1]: `fit(btf, config)`.

`python -m spmm_torch.fit INPUT -o RUN` is the same as `spmm fit INPUT -o RUN`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..runtime.lazy import lazy_names

if TYPE_CHECKING:
    from .pipeline import FitResult, fit

__all__ = ["FitResult", "fit"]

__getattr__, __dir__ = lazy_names(__name__, {"FitResult": ".pipeline", "fit": ".pipeline"})
