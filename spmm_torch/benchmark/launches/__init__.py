"""Part launches: what a GPU would be asked by the default fit, counted on a simulated one.

A GPU starts an operation about every 5 microseconds, however small it is, and the host that waits
for a result starts none. So a fit of few large operations is fast on it, one of many small ones is
not, whatever the GPU can compute.
"""

from __future__ import annotations

from typing import Any

import torch

from ...config.shipped import shipped
from ...runtime.context import Context
from ..fits import TimedFit, on_device, plain_fit
from ..scope import Bench, Scope
from ..variants import DEFAULT
from .by_stage import Asked, TallyWatch
from .simulation import simulated_cuda
from .tally import Tally

ALL = "total"  # the name under which `fit` times all stages together
LAUNCH_SECONDS = 5e-6  # of the host for one operation
WORST = 12  # lines of each kind that are published
Row = dict[str, Any]


def count(scope: Scope) -> int:
    """The number of measurements."""
    return 1


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Counts the operations of the default fit on a simulated GPU.

    Returns:
        `launch_seconds`, of one operation; `rows` with `stage`, `launches`, `waits`,
        `bytes_to_device`, `bytes_to_host` and `seconds`, of launching alone; `launches` and `waits`
        [line, count]: the worst lines.
    """
    with simulated_cuda(by_line=True) as tally:
        watch = TallyWatch(torch.device("cuda"), tally=tally)
        config = on_device(shipped(DEFAULT, bench.scope.overrides), watch.device)
        plain_fit(bench.open(), config, Context.build(config.device, config.seed, watch=watch))
    bench.advance()
    return counted(watch, tally)


def counted(watch: TallyWatch, tally: Tally) -> dict[str, Any]:
    """The results of `run`, of a watch and a tally that have seen a fit."""
    stages = {**watch.asked, ALL: Asked.so_far(tally)}
    return {
        "launch_seconds": LAUNCH_SECONDS,
        "rows": [
            {"stage": stage, **vars(asked), "seconds": LAUNCH_SECONDS * asked.launches}
            for stage, asked in stages.items()
        ],
        "launches": [{"line": line, "count": n} for line, n in tally.lines.most_common(WORST)],
        "waits": [{"line": line, "count": n} for line, n in tally.waits.most_common(WORST)],
    }
