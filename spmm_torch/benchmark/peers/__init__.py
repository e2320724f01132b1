"""Part peers: other methods for the same task, on the same data and the same machine.

Another peer is one module with a `PEER`, and one entry in `PEERS`.
"""

from __future__ import annotations

import importlib.util
from typing import Any

from ...config.shipped import shipped
from ...data import Selection
from ..fits import TimedFit, on_device, timed_fit
from ..scope import Bench, Scope
from ..variants import DEFAULT
from . import (
    local_pca,
    neural,
    neural_depth,
    one_lobe,
    own,
    scipy_nnls,
    scipy_search,
    sklearn_lasso,
    vector_quantization,
)
from .problem import Peer, Problem

PEERS: tuple[Peer, ...] = tuple(
    module.PEER
    for module in (
        own,
        one_lobe,
        vector_quantization,
        local_pca,
        neural,
        neural_depth,
        scipy_search,
        scipy_nnls,
        sklearn_lasso,
    )
)
EXTRA = "pip install 'spmm_torch[benchmark]'"
# Most texels of a problem, whose values peers hold as float32; of more, a part is taken.
MOST_TEXELS = 4096


def count(scope: Scope) -> int:
    """The number of measurements."""
    return len(PEERS)


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Measures every peer whose package is installed.

    Returns:
        `rows` of `problem.row` with the name of their `peer`; and `skipped`, with `peer` and
        `reason`.
    """
    problem = build_problem(bench, default)
    rows, skipped = [], []
    for peer in PEERS:
        if peer.package and importlib.util.find_spec(peer.package) is None:
            reason = f"{peer.package} is not installed; {EXTRA} installs it"
            bench.progress.say(f"peer {peer.name} skipped: {reason}")
            skipped.append({"peer": peer.name, "reason": reason})
        else:
            rows += [{"peer": peer.name, **row} for row in peer.run(problem)]
        bench.advance()
    return {"rows": rows, "skipped": skipped}


def build_problem(bench: Bench, default: TimedFit) -> Problem:
    """The decoded data and our own fit of them; of too many texels, a part and its fit."""
    btf = bench.open()
    if btf.texel_count > MOST_TEXELS:
        bench = bench.with_selection(Selection(texels=MOST_TEXELS))
        btf = bench.open()
        config = on_device(shipped(DEFAULT, bench.scope.overrides), bench.device)
        default = timed_fit(bench, config)
    return Problem(btf.load(), bench.scope, bench.device, default)
