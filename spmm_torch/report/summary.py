"""The report of a fit, from the results of its stages."""

from __future__ import annotations

import math
import os
import platform
from dataclasses import asdict, fields
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import scipy
import torch
from torch import Tensor

from ..data import BTF
from ..metrics import Totals, psnr_db
from ..model.spmm import SPMM
from ..runtime.context import Context
from ..runtime.memory import peak_resident_memory
from ..runtime.names import text_of
from ..solvers.status import StatusCounts
from .contract import (
    MSSIM,
    PSNR,
    SNR,
    Ablation,
    Display,
    FailedStarts,
    ObjectiveFigures,
    Report,
    Seconds,
    Sharpness,
    Sizes,
)
from .materials import materials
from .wording import decibels, fixed, percent, plural, times_smaller


def summarize(
    btf: BTF,
    model: SPMM,
    context: Context,
    *,
    totals: Totals,
    weighted: Totals | None,
    objective: ObjectiveFigures,
    starts: Tensor,
    solvers: StatusCounts,
    ablation: Ablation,
    auto: dict[str, Any] | None,
    mssim: dict[str, float] | None,
    sharpness: Sharpness | None,
    display: Display | None,
) -> Report:
    """All figures of a fit.

    Args:
        btf: the input.
        model: the fitted model.
        context: of the run.
        totals: squared errors over the whole input.
        weighted: the same by weight; None if all weights are equal.
        objective: what was minimized.
        starts: of the search `[3]`, see `FoundLobes.starts`.
        solvers: all solved problems by solver and status.
        ablation: SNR without each BRDF.
        auto: the choice of `--auto`.
        mssim: of the sphere pictures; None without pictures.
        sharpness, display: of slices; None without pictures.
    """
    count = btf.value_count
    peak = btf.peak()
    sizes = Sizes(**model.byte_counts())
    seconds = {each.name: context.watch.seconds.get(each.name, 0.0) for each in fields(Seconds)}
    errors = (totals.without_residual, totals.with_residual)
    known = {name: value for name, value in totals.snr_db().items() if not math.isnan(value)}
    return Report(
        input=text_of(os.path.abspath(btf.path)) if btf.path else btf.name,
        texels=btf.texel_count,
        direction_pairs=btf.measured_count,
        channels=btf.channels,
        clusters=model.cluster_count,
        total_basis=len(model.dictionary),
        mean_basis_per_texel=len(model.index) / btf.texel_count,
        bytes=sizes,
        bytes_per_texel=model.bytes_per_texel(),
        raw_bytes=btf.raw_bytes,
        compression_ratio=btf.raw_bytes / sizes.total,
        psnr_peak=peak,
        psnr_db=PSNR(*(psnr_db(peak, error, count) for error in errors)),
        snr_db=SNR(**known),
        weighted_snr_db=_weighted(weighted) if weighted else None,
        mssim=MSSIM(**mssim) if mssim else MSSIM(),
        sharpness=sharpness or Sharpness(),
        display=display or Display(),
        lobes_by_model=model.lobe_use_by_model(),
        objective=objective,
        failed_starts=failed_starts(starts),
        solvers=solvers.to_dict(),
        error_without_model=ablation,
        auto=auto,
        materials=[asdict(row) for row in materials(model, btf)] if btf.names else None,
        seconds=Seconds(**seconds),
        peak_memory_bytes=peak_memory(context.device),
        device=device_name(context.device),
        seed=context.seed,
        versions=versions(),
    )


def _weighted(totals: Totals) -> dict[str, float | None]:
    """SNR by weight; None where there is no such figure."""
    return {name: None if math.isnan(x) else x for name, x in totals.snr_db().items()}


def failed_starts(starts: Tensor) -> FailedStarts:
    """Failed starts of the search by cause, from `FoundLobes.starts [3]`."""
    total, not_finite, no_descent = starts.tolist()
    return FailedStarts(total, not_finite + no_descent, not_finite, no_descent)


def warning_of_failed_starts(starts: Tensor) -> str | None:
    """A warning if any of the `starts [3]` met NaN or infinity; None otherwise."""
    failed = failed_starts(starts)
    if not failed.not_finite:
        return None
    return (
        f"warning: {failed.not_finite} of {failed.starts} starts of the search met NaN or "
        f"infinity and were left out"
    )


def warning_of_narrow_lobes(objective: ObjectiveFigures) -> str | None:
    """What of the lobes is a guess; None where the directions resolve all of them."""
    if not objective.narrow_lobes or objective.narrow_energy is None:
        return None
    return (
        f"narrower than the sampling: {plural(objective.narrow_lobes, 'lobe')}, "
        f"{percent(objective.narrow_energy, 0)} of the energy; their widths are a guess"
    )


def headline(report: Report) -> str:
    """The result in one line, and what pictures show in two more where there are any."""
    snr = report.snr_db
    means = (
        "" if snr.cluster_mean is None else f" (bare cluster means {decibels(snr.cluster_mean)})"
    )
    line = (
        f"SNR {decibels(snr.without_residual)} without residual, {decibels(snr.with_residual)} "
        f"with it{means}, {report.mean_basis_per_texel:.1f} lobes a texel, "
        f"{times_smaller(report.compression_ratio)}, {report.seconds.total:.1f} s"
    )
    return "\n".join([line, *picture_lines(report.sharpness, report.display)])


def picture_lines(sharpness: Sharpness, display: Display) -> list[str]:
    """Sharpness in a line, and PSNR and FLIP on a display in another; none without slices."""
    if display.slices is None:
        return []
    above, everywhere = (
        f"{percent(share, 0)} ({percent(in_place, 0)} in place)"
        for share, in_place in (
            (sharpness.from_above, sharpness.in_place_from_above),
            (sharpness.all_views, sharpness.in_place_all_views),
        )
    )
    psnr, flip = display.psnr_db, display.flip
    shown = (
        f"on a display PSNR {decibels(psnr.without_residual)} without residual, "
        f"{decibels(psnr.with_residual)} with it"
    )
    if flip.with_residual is not None:
        shown += f", FLIP {fixed(flip.with_residual, 3)}"
    return [f"sharpness {above} seen from above, {everywhere} over all views", shown]


def peak_memory(device: torch.device) -> int:
    """Bytes: of the process on a CPU, of torch's allocations on a GPU."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device)
    return peak_resident_memory()


def device_name(device: torch.device) -> str:
    """The name of a device, for people."""
    if device.type == "cuda":
        return f"{device} ({torch.cuda.get_device_name(device)})"
    return f"{device} ({torch.get_num_threads()} threads)"


def versions() -> dict[str, str]:
    """Versions of the packages that can change the figures."""
    try:
        own = version("spmm_torch")
    except PackageNotFoundError:  # run from a checkout
        own = "checkout"
    return {
        "spmm_torch": own,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
