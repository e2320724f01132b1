"""One lobe for each texel (m = 1): a single analytical BRDF with a tilted normal."""

from __future__ import annotations

from ...config.shipped import shipped
from ..fits import on_device, plain_fit
from ..protocol import Timing
from ..variants import DEFAULT
from .problem import WHOLE, Peer, Problem, Row, row

ONE = "select.max_lobes=1"


def run(problem: Problem) -> list[Row]:
    """Our own fit with at most one lobe, without and with the residual of each cluster."""
    config = on_device(shipped(DEFAULT, (*problem.scope.overrides, ONE)), problem.device)
    report = plain_fit(problem.btf, config).report
    seconds, size = report["seconds"], report["bytes"]
    timing = Timing((seconds["total"] - seconds["load"],))
    kinds = (
        ("one lobe", "without_residual", size["weights"] + size["dictionary"]),
        ("one lobe with residual", "with_residual", size["total"]),
    )
    return [
        row(
            name,
            WHOLE,
            problem.btf.texel_count,
            timing,
            report["snr_db"][key],
            size=total,
            lobes=report["mean_basis_per_texel"],
        )
        for name, key, total in kinds
    ]


PEER = Peer("one lobe", "one rotated analytical lobe a texel, by our own fit", run)
