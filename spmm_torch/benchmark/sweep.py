"""Part sweep: our own settings compared in seconds, bytes and decibels."""

from __future__ import annotations

from typing import Any

from ..config.shipped import shipped
from .fits import SharedStages, TimedFit, on_device, timed_fit
from .front import pareto_front
from .scope import Bench, Scope
from .variants import DEFAULT, SHIPPED, VARIANTS, Variant

SHIPPED_GROUP = "shipped"
Row = dict[str, Any]


def variants_of(scope: Scope) -> tuple[Variant, ...]:
    """The variants that are swept."""
    return tuple(v for v in VARIANTS if scope.sweep is None or v.group in scope.sweep)


def count(scope: Scope) -> int:
    """The number of measurements."""
    return len(SHIPPED) + len(variants_of(scope))


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Measures all shipped settings, and all variants of the default.

    Returns:
        `rows` with the keys of `TimedFit.row` and `name`, `group`, `changes`, `mean_snr_db` (over
        both errors) and `on_front`: of mean SNR against `seconds`, `bytes` and `both`.
    """
    rows = [_shipped(bench, name, default) for name in SHIPPED]
    base = shipped(DEFAULT, bench.scope.overrides)
    with SharedStages.open() as shared:
        for variant in variants_of(bench.scope):
            config = on_device(base.override(list(variant.changes)), bench.device)
            row = _row(shared.fit(bench, config), variant.name, variant.group)
            rows.append({**row, "changes": list(variant.changes)})
            bench.advance()
    quality = [row["mean_snr_db"] for row in rows]
    seconds = [row["seconds"]["median"] for row in rows]
    size = [row["bytes"]["total"] for row in rows]
    costs = {"seconds": (seconds,), "bytes": (size,), "both": (seconds, size)}
    fronts = {name: pareto_front(quality, *cost) for name, cost in costs.items()}
    for number, row in enumerate(rows):
        row["on_front"] = {name: front[number] for name, front in fronts.items()}
    return {"rows": rows}


def _shipped(bench: Bench, name: str, default: TimedFit) -> Row:
    config = on_device(shipped(name, bench.scope.overrides), bench.device)
    timed = default if name == DEFAULT else timed_fit(bench, config)
    row = _row(timed, name, SHIPPED_GROUP)
    bench.advance()
    return {**row, "changes": list(bench.scope.overrides)}


def _row(timed: TimedFit, name: str, group: str) -> Row:
    row = timed.row()
    snr = row["snr_db"]
    mean = 0.5 * (snr["without_residual"] + snr["with_residual"])
    return {"name": name, "group": group, **row, "mean_snr_db": mean}
