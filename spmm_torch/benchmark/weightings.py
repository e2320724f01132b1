"""Part weightings: SNR and similarity of pictures for each weighting of errors."""

from __future__ import annotations

from statistics import mean
from typing import Any

from ..config.shipped import shipped
from ..evaluate import likeness
from ..evaluate.flip import flip
from .fits import TimedFit, on_device, timed_fit
from .scope import Bench, Scope
from .variants import DEFAULT

# `weights.error` of the default comes first.
KINDS = ("auto", "cube-root", "log")


def count(scope: Scope) -> int:
    """The number of measurements."""
    return len(KINDS)


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Fits with each weighting, and compares pictures of a sphere with those of the input.

    Returns:
        `rows` with the keys of `TimedFit.row` and `error`, `mssim` {y, cr, cb, mean} and `flip`
        (null without the extra `eval`).
    """
    btf = bench.open().load()
    rows = []
    for kind in KINDS:
        timed = default if kind == KINDS[0] else _fit(bench, kind)
        found = likeness(timed.result.model, btf, bench.device)
        errors = flip(found.spheres)
        seen = {"mssim": found.mssim, "flip": None if errors is None else mean(errors)}
        rows.append({"error": kind, **timed.row(), **seen})
        bench.advance()
    return {"rows": rows}


def _fit(bench: Bench, kind: str) -> TimedFit:
    overrides = (*bench.scope.overrides, f"weights.error={kind}")
    return timed_fit(bench, on_device(shipped(DEFAULT, overrides), bench.device))
