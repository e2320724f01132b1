"""Part scaling: growth of time with texels and directions, and its fall with threads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ..config.fit import FitConfig
from ..config.shipped import shipped
from ..data import BTF, Selection
from ..data.store import Loading, Store
from ..geometry.directions import UBO2003_RINGS, UBO2014_RINGS
from ..runtime.threads import cpu_threads
from .fits import TimedFit, on_device, plain_fit
from .materials import tiled, with_directions
from .scope import Bench, Scope
from .variants import DEFAULT

RINGS = (UBO2003_RINGS, UBO2014_RINGS)
# Stages that take less than this are too short for an exponent.
LEAST_SECONDS = 0.05
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One fit: size, device and threads.

    Attributes:
        varies: `texels` or `directions`.
        texels: their number.
        rings: of the directions; None for those of the input.
        device: of the fit.
        threads: of the CPU.
    """

    varies: str
    texels: int
    rings: tuple[tuple[float, int], ...] | None
    device: torch.device
    threads: int


def cases(scope: Scope, devices: Sequence[torch.device], threads: int) -> list[Case]:
    """All fits: on all threads, and the smaller ones on one thread, too."""
    found = []
    for device in devices:
        found += [Case("texels", count, None, device, threads) for count in scope.texels]
        if device.type == "cpu" and threads > 1:
            few = [count for count in scope.texels if count <= scope.few_texels]
            found += [Case("texels", count, None, device, 1) for count in few]
        found += [Case("directions", scope.direction_texels, r, device, threads) for r in RINGS]
    return found


def devices() -> list[torch.device]:
    """The CPU, and CUDA where available."""
    return [torch.device("cpu")] + [torch.device("cuda")] * torch.cuda.is_available()


def count(scope: Scope) -> int:
    """The number of measurements."""
    return len(cases(scope, devices(), torch.get_num_threads()))


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Fits the input at several sizes with default settings.

    Decoding is not timed: values lie in memory, and repeats are computed on the fly.

    Returns:
        `rows` with `varies`, `texels`, `direction_pairs`, `device`, `threads`, `seconds` by stage;
        `exponents`, see `exponents`.
    """
    config = shipped(DEFAULT, bench.scope.overrides)
    source = bench.open()
    base = source.open_store(source.part, Loading())
    rows = []
    for case in cases(bench.scope, devices(), torch.get_num_threads()):
        rows.append(_measured(case, _material(bench, source, base, case), config))
        bench.advance()
    return {"rows": rows, "exponents": exponents(rows)}


def _material(bench: Bench, source: BTF, base: Store, case: Case) -> BTF:
    if case.rings is None:
        return tiled(source, base, case.texels)
    few = Selection(texels=case.texels, directions=bench.scope.selection.directions)
    return with_directions(bench.with_selection(few).open(), case.rings)


def _measured(case: Case, btf: BTF, config: FitConfig) -> Row:
    with cpu_threads(case.threads):
        report = plain_fit(btf.load(), on_device(config, case.device)).report
    return {
        "varies": case.varies,
        "texels": btf.texel_count,
        "direction_pairs": btf.pair_count,
        "device": str(case.device),
        "threads": case.threads,
        "seconds": report["seconds"],
        "snr_db": report["snr_db"],
        "total_basis": report["total_basis"],
    }


def exponents(rows: Sequence[Row]) -> list[Row]:
    """Growth of seconds with texels and direction pairs, by device and number of threads.

    Returns:
        rows with `varies`, `device`, `threads` and `power`: by stage the exponent p of the fit
        seconds ~ size^p, in logarithms; None where the times are too short.
    """
    keys = dict.fromkeys((row["varies"], row["device"], row["threads"]) for row in rows)
    found = []
    for varies, device, threads in keys:
        own = [
            row
            for row in rows
            if (row["varies"], row["device"], row["threads"]) == (varies, device, threads)
        ]
        sizes = [row["texels" if varies == "texels" else "direction_pairs"] for row in own]
        power = {
            stage: exponent(sizes, [row["seconds"][stage] for row in own])
            for stage in own[0]["seconds"]
        }
        found.append({"varies": varies, "device": device, "threads": threads, "power": power})
    return found


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float | None:
    """The least-squares p of seconds ~ size^p, from measurements that are long enough."""
    pairs = [(s, t) for s, t in zip(sizes, seconds, strict=True) if t >= LEAST_SECONDS]
    if len({size for size, _ in pairs}) < 2:
        return None
    x, y = (np.log(column) for column in zip(*pairs, strict=True))
    power = float(np.polyfit(x, y, 1)[0])
    return power if math.isfinite(power) else None
