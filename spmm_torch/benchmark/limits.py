"""Part limits: the time of each stage against the least time that the machine allows.

The machine is measured in the same run: the speed of a matrix product in float32, and of a copy.
The least work of a stage is that of any program for the same algorithm: to read its input once a
pass, and to multiply what the algorithm multiplies. The limit is the larger of both times.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import torch

from ..config.fit import ClusterConfig
from ..config.shipped import shipped
from ..data import BTF
from ..data.named_pictures import list_pictures
from ..data.picture_set import PictureSet
from ..data.pictures import is_container, open_archive
from ..fit.cluster import OVERSAMPLING
from ..fit.pipeline import FitResult
from ..runtime.context import Context
from ..runtime.memory import slices
from .counting import CountingStopwatch, Work
from .fits import TimedFit, on_device, plain_fit
from .protocol import Timing, measure
from .scope import Bench, Scope
from .variants import DEFAULT

FLOAT = 4
# Stages here, and their names in the report; `select` is all work on texels and given lobes.
STAGES = {
    "load": ("load",),
    "cluster": ("cluster",),
    "search": ("search",),
    "dictionary": ("dictionary",),
    "select": ("select", "refit", "evaluate"),
    "residual": ("residual",),
}
# Passes of the range finder over all values, and its products in each pass.
PASSES, PRODUCTS = 2, 3
MEASUREMENTS = 4  # product, copy, bare decoding, counting
Row = dict[str, Any]


def count(scope: Scope) -> int:
    """The number of measurements."""
    return MEASUREMENTS


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Measures the machine, and compares each stage of the default fit with its limit.

    Returns:
        `machine`, see `machine_speed`; `bare_decoding`; `rows` with `stage`, `seconds`, `flops`
        and `bytes` of its least work, `limit_seconds`, `fraction` (limit over seconds), and
        `counted_flops`, `counted_bytes`, `counted_fraction` of the operations that really ran.
    """
    machine = machine_speed(bench)
    bare = bare_decoding(bench)
    bench.advance()
    work = counted(bench)
    bench.advance()
    btf = bench.open()
    needed = least_work(btf, default.result, work.get("search", Work()))
    rows = []
    for stage, parts in STAGES.items():
        seconds = sum(default.stages[part] for part in parts)
        done = sum((work.get(part, Work()) for part in parts), Work())
        rows.append(_row(stage, seconds, needed[stage], done, machine))
    if bare is not None:
        rows[0]["limit_seconds"] = max(bare.median, rows[0]["limit_seconds"])
        rows[0]["fraction"] = rows[0]["limit_seconds"] / rows[0]["seconds"]
    decoding = None if bare is None else bare.to_dict()
    return {"machine": machine, "bare_decoding": decoding, "rows": rows}


def _row(stage: str, seconds: float, needed: Work, done: Work, machine: Row) -> Row:
    limit, counted_limit = seconds_of(needed, machine), seconds_of(done, machine)
    return {
        "stage": stage,
        "seconds": seconds,
        "flops": needed.flops,
        "bytes": needed.bytes,
        "limit_seconds": limit,
        "fraction": limit / seconds if seconds > 0.0 else None,
        "counted_flops": done.flops,
        "counted_bytes": done.bytes,
        "counted_fraction": counted_limit / seconds if seconds > 0.0 else None,
    }


def seconds_of(work: Work, machine: Row) -> float:
    """The least time of some work on the machine."""
    return max(work.flops / machine["flops_per_second"], work.bytes / machine["bytes_per_second"])


def machine_speed(bench: Bench) -> Row:
    """Speed of the machine: `flops_per_second` of a product, `bytes_per_second` of a copy."""
    scope, device = bench.scope, bench.device
    matrix = torch.rand(scope.product, scope.product, device=device)
    source = torch.rand(scope.copied // FLOAT, device=device)
    target = torch.empty_like(source)
    _, product = measure(lambda: matrix @ matrix, scope.protocol, device)
    bench.advance()
    _, copy = measure(lambda: target.copy_(source), scope.protocol, device)
    bench.advance()
    return {
        "flops_per_second": 2.0 * scope.product**3 / product.median,
        "bytes_per_second": 2.0 * scope.copied / copy.median,
        "product": product.to_dict(),
        "copy": copy.to_dict(),
    }


def bare_decoding(bench: Bench) -> Timing | None:
    """Seconds to decode all pictures in as many threads as the reader has, and to drop them.

    None unless the input is a set of pictures that is read as a whole.
    """
    named = is_container(bench.source) and list_pictures(bench.source, bench.reading.pattern)
    if not named or not bench.open().part.is_whole:
        return None
    pictures = PictureSet.scan(bench.source, bench.reading)
    files = [name for name in pictures.grid.files if name is not None]

    def work() -> None:
        with open_archive(bench.source) as archive:

            def decode(part: slice) -> None:
                for payload in archive.read(files[part]):
                    pictures.form.codec.decode(payload)

            with ThreadPoolExecutor(bench.reading.thread_count) as pool:
                for _ in pool.map(decode, slices(len(files), len(pictures.grid.light))):
                    pass  # raises what a thread raised

    return measure(work, bench.scope.protocol, torch.device("cpu"))[1]


def counted(bench: Bench) -> dict[str, Work]:
    """The work of each stage of the default fit, counted while it runs."""
    watch = CountingStopwatch(bench.device)
    config = on_device(shipped(DEFAULT, bench.scope.overrides), bench.device)
    plain_fit(bench.open(), config, Context.build(config.device, config.seed, watch=watch))
    return dict(watch.work)


def least_work(btf: BTF, result: FitResult, search: Work) -> dict[str, Work]:
    """The least work of each stage.

    Args:
        btf: the input.
        result: of the fit.
        search: counted work of the search, whose flops stand for the least: it has no formula.
    """
    texels, pairs, channels = btf.texel_count, btf.pair_count, btf.channels
    values, raw = texels * pairs * channels, btf.raw_bytes
    lobes, found = result.report["total_basis"], result.info["lobes_found"]
    samples, clusters = len(result.info["samples"]), result.report["clusters"]
    rank = min(ClusterConfig().components + OVERSAMPLING, texels, pairs * channels)
    return {
        "load": Work(0.0, float(raw)),
        "cluster": Work(2.0 * PRODUCTS * rank * values, float(PASSES * raw)),
        "search": Work(search.flops, float(FLOAT * samples * pairs * channels)),
        "dictionary": Work(2.0 * found * found * pairs, float(FLOAT * found * pairs)),
        "select": Work(2.0 * lobes * values, float(raw + FLOAT * texels * lobes * channels)),
        "residual": Work(
            2.0 * clusters * lobes * pairs * channels, 2.0 * FLOAT * clusters * pairs * channels
        ),
    }
