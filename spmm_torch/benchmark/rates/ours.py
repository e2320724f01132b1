"""Our own model at several ranks of its residual, with a relief and without one."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ...config.shipped import shipped
from ...evaluate.slices import slice_figures
from ...fit.pipeline import FitResult
from ...model.relief import Relief
from ...runtime.context import Context
from ..fits import SHARED, on_device, plain_fit
from ..variants import DEFAULT
from .subject import Row, Subject

# `relief.mode` of the two lines, and their names.
MODES = {"auto": "ours, relief", "off": "ours, flat"}
# Stages that depend on the rank of the residual; all earlier ones are shared between ranks.
LAST_STAGES = "sweep-*.safetensors"


def our_rows(subject: Subject) -> tuple[list[Row], Relief | None]:
    """A point for each rank and both kinds, and the relief that was found; None: none."""
    rows, reliefs = [], {}
    for mode, curve in MODES.items():
        for rank, result in _fits(subject, mode):
            rows.append(_row(subject, curve, rank, result))
            reliefs[mode] = result.model.relief
            subject.bench.advance()
    return rows, reliefs["auto"]


def _fits(subject: Subject, mode: str) -> list[tuple[int, FitResult]]:
    """A fit for each rank, the highest first: its principal coordinates serve lower ones."""
    bench, results = subject.bench, []
    base = on_device(shipped(DEFAULT, bench.scope.overrides), bench.device)
    with tempfile.TemporaryDirectory(prefix="spmm_torch-rates-") as folder:
        for rank in sorted(bench.scope.ranks, reverse=True):
            config = base.override([f"relief.mode={mode}", f"residual.rank={rank}"])
            context = Context.build(
                config.device, config.seed, state=Path(folder), depends_on=SHARED
            )
            results.append((rank, plain_fit(subject.btf, config, context)))
            for path in Path(folder).glob(LAST_STAGES):
                path.unlink()
    return results


def _row(subject: Subject, curve: str, rank: int, result: FitResult) -> Row:
    report, model = result.report, result.model
    seconds = report["seconds"]
    return subject.point(
        curve,
        f"rank {rank}",
        report["bytes_per_texel"],
        report["bytes"]["total"],
        report["snr_db"]["with_residual"],
        slice_figures(model, subject.btf).display.flip.with_residual,
        seconds["total"] - seconds["load"],
        ours=True,
    )
