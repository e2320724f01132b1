"""Fit a sparse parametric mixture model to a BTF [WDR11 §3.2, §4.1]: `fit(btf, config)`.

`python -m spmm_torch.fit INPUT -o RUN` is the same as `spmm fit INPUT -o RUN`.
"""

from .pipeline import FitResult, fit

__all__ = ["FitResult", "fit"]
