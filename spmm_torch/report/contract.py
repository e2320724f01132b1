"""`report.json`: its keys, and how it is written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

# Every key in its order, with the keys below it; () if the value has none, or free ones.
REPORT_KEYS: dict[str, tuple[str, ...]] = {
    "input": (),
    "texels": (),
    "direction_pairs": (),
    "channels": (),
    "clusters": (),
    "total_basis": (),
    "mean_basis_per_texel": (),
    "bytes": ("weights", "dictionary", "residual", "total"),
    "raw_bytes": (),
    "compression_ratio": (),
    "psnr_peak": (),
    "psnr_db": ("without_residual", "with_residual"),
    "snr_db": ("without_residual", "with_residual", "cluster_mean"),
    # By the weights of the fit; null where all values count alike.
    "weighted_snr_db": (),
    "mssim": ("y", "cr", "cb", "mean"),
    "lobes_by_model": (),
    "failed_starts": ("starts", "count", "not_finite", "no_descent"),
    # Of some texels: signal-to-noise ratio of lobes alone, and that without each model.
    "error_without_model": ("texels", "snr_db", "snr_db_without"),
    # What was found to pay; null without --auto.
    "auto": (),
    "seconds": (
        "load",
        "cluster",
        "search",
        "dictionary",
        "select",
        "refit",
        "residual",
        "evaluate",
        "total",
    ),
    "peak_memory_bytes": (),
    "device": (),
    "seed": (),
    "versions": (),
}
FILE_NAME = "report.json"


def check_report(report: Mapping[str, Any]) -> None:
    """Check that a report has the keys of `REPORT_KEYS` and no others.

    Raises:
        ValueError: keys are missing or unknown; the text names all of them.
    """
    expected, found = set(REPORT_KEYS), set(report)
    for key, below in REPORT_KEYS.items():
        value = report.get(key)
        if below and key in report:
            expected |= {f"{key}.{name}" for name in below}
            found |= {f"{key}.{name}" for name in value} if isinstance(value, Mapping) else set()
    complaints = [
        f"{what} {', '.join(sorted(keys))}"
        for what, keys in (("missing:", expected - found), ("unknown:", found - expected))
        if keys
    ]
    if complaints:
        raise ValueError("report keys " + "; ".join(complaints))


def write_report(folder: Path, report: Mapping[str, Any]) -> Path:
    """Write `report.json` into `folder`, keys in the order of `REPORT_KEYS`, and return its path.

    JSON knows neither NaN nor infinity: both become null.

    Raises:
        ValueError: keys are missing or unknown.
    """
    check_report(report)
    ordered = {
        key: {name: report[key][name] for name in below} if below else report[key]
        for key, below in REPORT_KEYS.items()
    }
    path = folder / FILE_NAME
    path.write_text(json_text(ordered), encoding="utf-8")
    return path


def json_text(content: Mapping[str, Any]) -> str:
    """The text of a JSON file, null for each number that is not finite."""
    return json.dumps(_finite(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _finite(value: Any) -> Any:
    """The same value with None for each number that is not finite."""
    if isinstance(value, Mapping):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
