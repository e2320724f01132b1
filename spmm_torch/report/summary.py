"""The figures of a fit, with the keys of `report.json`."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import scipy
import torch
from torch import Tensor

from ..data import BTF
from ..metrics import Totals, psnr_db
from ..model.spmm import SPMM
from ..runtime.memory import peak_resident_memory

STAGES = ("load", "cluster", "search", "dictionary", "select", "refit", "residual", "evaluate")


def summarize(
    btf: BTF,
    model: SPMM,
    totals: Totals,
    seconds: dict[str, float],
    seed: int,
    device: torch.device,
    starts: Tensor,
) -> dict[str, Any]:
    """All figures of a fit; `mssim` is null, for whoever renders to fill in.

    Args:
        btf: the input.
        model: the fitted model.
        totals: squared errors over the whole input.
        seconds: by stage, and `total`.
        seed: of the fit.
        device: on which it ran.
        starts: of the search, see `FoundLobes.starts`.
    """
    count = btf.texel_count * btf.measured_count * btf.channels
    peak = btf.peak()
    sizes = model.byte_counts()
    errors = {
        "without_residual": totals.without_residual,
        "with_residual": totals.with_residual,
    }
    return {
        "input": btf.path or btf.name,
        "texels": btf.texel_count,
        "direction_pairs": btf.measured_count,
        "channels": btf.channels,
        "clusters": model.cluster_count,
        "total_basis": len(model.dictionary),
        "mean_basis_per_texel": len(model.index) / btf.texel_count,
        "bytes": sizes,
        "raw_bytes": btf.raw_bytes,
        "compression_ratio": btf.raw_bytes / sizes["total"],
        "psnr_peak": peak,
        "psnr_db": {name: psnr_db(peak, error, count) for name, error in errors.items()},
        "snr_db": totals.snr_db(),
        "weighted_snr_db": None,
        "mssim": dict.fromkeys(("y", "cr", "cb", "mean")),
        "lobes_by_model": model.lobe_use_by_model(),
        "failed_starts": failed_starts(starts),
        "error_without_model": dict.fromkeys(("texels", "snr_db", "snr_db_without")),
        "auto": None,
        "seconds": {name: seconds.get(name, 0.0) for name in (*STAGES, "total")},
        "peak_memory_bytes": peak_memory(device),
        "device": device_name(device),
        "seed": seed,
        "versions": versions(),
    }


def failed_starts(starts: Tensor) -> dict[str, int]:
    """How many starts of the search failed, and how, of `FoundLobes.starts [3]`."""
    total, not_finite, no_descent = starts.tolist()
    return {
        "starts": total,
        "count": not_finite + no_descent,
        "not_finite": not_finite,
        "no_descent": no_descent,
    }


def warning_of_failed_starts(starts: Tensor) -> str | None:
    """One sentence where starts of the search met no number; the others went on without them."""
    failed = failed_starts(starts)
    if not failed["not_finite"]:
        return None
    return (
        f"warning: {failed['not_finite']} of {failed['starts']} starts of the search met NaN or "
        f"infinity and were left out"
    )


def headline(report: dict[str, Any]) -> str:
    """The result in one line."""
    snr, seconds = report["snr_db"], report["seconds"]["total"]
    return (
        f"SNR {snr['without_residual']:.2f} dB without residual, {snr['with_residual']:.2f} dB "
        f"with it (bare cluster means {snr['cluster_mean']:.2f} dB), "
        f"{report['mean_basis_per_texel']:.1f} lobes a texel, "
        f"1:{report['compression_ratio']:.0f}, {seconds:.1f} s"
    )


def peak_memory(device: torch.device) -> int:
    """Bytes: of the process on a CPU, of torch's allocations on a GPU."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device)
    return peak_resident_memory()


def device_name(device: torch.device) -> str:
    """What the fit ran on, for people."""
    if device.type == "cuda":
        return f"{device} ({torch.cuda.get_device_name(device)})"
    return f"{device} ({torch.get_num_threads()} threads)"


def versions() -> dict[str, str]:
    """Versions of what can change the figures."""
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
