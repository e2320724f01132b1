"""Parts that fit: agreement of CPU and GPU, the sample, and BTFs that are made up."""

from __future__ import annotations

from functools import partial
from typing import Any

import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.benchmark.counting import CountingStopwatch
from spmm_torch.benchmark.fits import plain_fit
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.shipped import shipped
from spmm_torch.fit import FitResult
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.stopwatch import Stopwatch
from tests.benchmarks.on_gpu.made_up import sample, tiled
from tests.benchmarks.on_gpu.measuring import forget_peak, peak_of
from tests.benchmarks.on_gpu.rows import Put, Row
from tests.benchmarks.on_gpu.sizes import Sizes

# Two devices agree where errors differ by no more than this, and as many lobes are the same: a
# sample that two lobes fit equally well may end with either.
DECIBELS, SHARED = 0.05, 0.95
# Lobes are the same where parameters differ by less than this fraction, and normals in radians.
PARAMETERS, NORMALS = 0.05, 0.02


def settings(name: str, device: str, sizes: Sizes) -> FitConfig:
    """Settings that ship, on a device."""
    return shipped(name, sizes.overrides).override([f"device={device}"])


def noted(result: FitResult) -> str:
    """Errors and size of a fit, in words."""
    report = result.report
    lobes, whole = (report["snr_db"][f"{name}_residual"] for name in ("without", "with"))
    return f"{lobes:.2f} dB, {whole:.2f} dB with residual, {report['total_basis']} lobes"


def put_stages(name: str, watch: Stopwatch, put: Put, peak: int | None, note: str) -> None:
    """A row for each stage, and one for all of them."""
    work = watch.work if isinstance(watch, CountingStopwatch) else {}
    for stage, seconds in watch.seconds.items():
        done = work.get(stage)
        counts = (done.flops, done.bytes) if done else (None, None)
        whole = stage == "total"
        put(Row(f"{name}: {stage}", seconds, *counts, peak if whole else None, note * whole))


def fits(name: str, side: int | None, device: str, sizes: Sizes, put: Put) -> None:
    """A fit by `default.yaml` from decoded values, timed; once more, to count its work; and again.

    Args:
        name: of the rows.
        side: texels of a made-up BTF; None: the sample.
        device, sizes: of the benchmark.
        put: takes the rows.
    """
    btf = sample(sizes.selection)
    btf = btf if side is None else tiled(btf, side)
    where, config = torch.device(device), settings("default", device, sizes)
    watch, counting = Stopwatch(where), CountingStopwatch(where)
    warm_up(device)
    forget_peak(where)
    note = "not finished"
    try:
        note = noted(run(btf, config, watch))
    finally:  # also when its time is over
        put_stages(name, watch, put, peak_of(where), note)
    run(btf, config, counting)
    counted = CountingStopwatch(where, seconds=watch.seconds, work=counting.work)
    put_stages(name, counted, put, peak_of(where), note)
    again = Stopwatch(where)
    run(btf, config, again)
    note = f"{note}; the first run took {watch.seconds['total']:.2f} s"
    warm = CountingStopwatch(where, seconds=again.seconds, work=counting.work)
    put_stages(name, warm, put, peak_of(where), note)


def run(btf: BTF, config: FitConfig, watch: Stopwatch) -> FitResult:
    """A fit, timed by a watch."""
    context = Context.build(config.device, config.seed, watch=watch)
    return plain_fit(btf, config, context)


def warm_up(device: str) -> None:
    """Loads what a first product, factorization and sort load."""
    matrix = torch.eye(64, device=device)
    torch.linalg.cholesky_ex(matrix.double() @ matrix.double())
    torch.linalg.solve(matrix, matrix).flatten().sort()


def agreement(device: str, sizes: Sizes, put: Put) -> None:
    """The fit of the sample by `smoke.yaml` on the CPU and on the device.

    Raises:
        AssertionError: errors or lobes differ by more than they may.
    """
    btf, results = sample(sizes.selection), {}
    for name in ("cpu", device):
        watch = Stopwatch(torch.device(name))
        found = results[name] = run(btf, settings("smoke", name, sizes), watch)
        label = f"smoke.yaml, {name}"
        put(Row(label, watch.seconds["total"], note=noted(found)))
    host, there = results["cpu"], results[device]
    differences = [
        abs(there.report["snr_db"][key] - value) for key, value in host.report["snr_db"].items()
    ]
    shared = min(shared_lobes(host, there), shared_lobes(there, host))
    note = f"errors within {max(differences):.3f} dB, {100 * shared:.0f} % of lobes the same"
    put(Row("CPU against device", note=note))
    assert max(differences) <= DECIBELS and shared >= SHARED, note


def shared_lobes(one: FitResult, other: FitResult) -> float:
    """The fraction of the lobes of one model that the other has, too."""
    own, theirs = (result.model.dictionary.detach() for result in (one, other))
    return float(same_lobe(own, theirs).any(1).float().mean())


def same_lobe(own: LobeBatch, theirs: LobeBatch) -> Tensor:
    """Whether lobes `[J]` and `[K]` are the same, `[J, K]`; turns about the normal apart."""
    model = own.model[:, None] == theirs.model
    away = torch.linalg.vector_norm(own.normal[:, None] - theirs.normal, dim=-1)
    size = own.kappa.abs()[:, None].clamp(min=1e-6)
    change = ((own.kappa[:, None] - theirs.kappa).abs() / size).amax(-1)
    return model & (away < NORMALS) & (change < PARAMETERS)


def small(device: str, sizes: Sizes, put: Put) -> None:
    """The fit of a made-up BTF of 64 x 64 texels."""
    fits(f"{sizes.small} x {sizes.small}", sizes.small, device, sizes, put)


def full(device: str, sizes: Sizes, put: Put) -> None:
    """The fit of a made-up BTF of full size."""
    fits(f"{sizes.full} x {sizes.full}", sizes.full, device, sizes, put)


FITS: dict[str, Any] = {"sample": partial(fits, "sample", None), "small": small, "full": full}
