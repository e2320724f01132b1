"""Settings of fits as the paper has them: a flat surface, residuals of clusters, exact weights."""

from __future__ import annotations

FLAT: dict[str, dict[str, object]] = {
    "relief": {"mode": "off"},
    "residual": {"rank": 0, "clusters": True},
    "storage": {"weights": "float32"},
}
# The same for `FitConfig.override` and, with `--set=` before each, for `spmm fit`.
FLAT_ASSIGNMENTS = [
    "relief.mode=off",
    "residual.rank=0",
    "residual.clusters=true",
    "storage.weights=float32",
]
FLAT_OPTIONS = [f"--set={assignment}" for assignment in FLAT_ASSIGNMENTS]
