"""Timed fits, from the input on disk to the model."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from ..config.fit import FitConfig
from ..data import BTF
from ..fit.cluster import coordinate_count
from ..fit.pipeline import FitResult, fit, with_lobe_limit
from ..runtime.context import Context
from .protocol import Timing, forget_peak, stage_medians
from .scope import Bench

# Stages that a fit can take over from another one with the same settings for them.
# Key of stages that fits of different later settings share.
SHARED = "shared"
EARLY_STAGES = ("relief.safetensors", "cluster.safetensors", "search.safetensors")
# Settings that only matter after these stages, but for the number of principal coordinates.
LATER_SETTINGS = {"dictionary", "select", "residual", "refit", "storage"}


@dataclass(frozen=True)
class TimedFit:
    """A fit and its time.

    Attributes:
        result: of the last run.
        timing: seconds from the input on disk to the model.
        stages: median seconds by stage.
        peak_known: whether the report's peak of memory is that of this fit alone.
    """

    result: FitResult
    timing: Timing
    stages: dict[str, float]
    peak_known: bool

    @property
    def seconds_after_load(self) -> float:
        """Seconds from decoded values to the model."""
        return self.stages["total"] - self.stages["load"]

    def row(self) -> dict[str, Any]:
        """The figures, as `benchmark.json` has them."""
        report = self.result.report
        return {
            "seconds": self.timing.to_dict(),
            "stages": self.stages,
            "snr_db": report["snr_db"],
            "mean_basis_per_texel": report["mean_basis_per_texel"],
            "total_basis": report["total_basis"],
            "bytes": report["bytes"],
            "compression_ratio": report["compression_ratio"],
            "peak_memory_bytes": report["peak_memory_bytes"] if self.peak_known else None,
        }


def plain_fit(btf: BTF, config: FitConfig, context: Context | None = None) -> FitResult:
    """A fit without pictures, as every part of a benchmark times it."""
    return fit(btf, config, context, render=False)


def timed_fit(bench: Bench, config: FitConfig) -> TimedFit:
    """A fit of the input, repeated by the protocol."""
    protocol, results, known = bench.scope.protocol, [], True
    while not results or (
        len(results) < protocol.repeats and sum(_totals(results)) < protocol.patience
    ):
        known &= forget_peak(bench.device)
        results.append(plain_fit(bench.open(), config))
    return _timed(results, known)


@dataclass
class SharedStages:
    """Early stages of fits, kept on disk for others with the same settings.

    Stages that a fit takes over are not timed again: its report has the seconds of their own run.
    """

    folder: Path
    kept: dict[str, Path] = field(default_factory=dict)

    @classmethod
    @contextmanager
    def open(cls) -> Iterator[SharedStages]:
        """Keeps the stages until the context ends."""
        with tempfile.TemporaryDirectory(prefix="spmm_torch-benchmark-") as folder:
            yield cls(Path(folder))

    def fit(self, bench: Bench, config: FitConfig) -> TimedFit:
        """One fit, with the early stages of an earlier one of the same settings if there is one."""
        key = _early_settings(config)
        state = self.folder / "state"
        state.mkdir()
        for path in self._files(self.kept.get(key)):
            shutil.copy2(path, state / path.name)
        known = forget_peak(bench.device)
        context = Context.build(config.device, config.seed, state=state, depends_on=SHARED)
        result = plain_fit(bench.open(), config, context)
        if key not in self.kept:
            self.kept[key] = self.folder / str(len(self.kept))
            self.kept[key].mkdir()
            for path in self._files(state):
                path.rename(self.kept[key] / path.name)
        shutil.rmtree(state)
        return _timed([result], known)

    @staticmethod
    def _files(folder: Path | None) -> list[Path]:
        paths = [] if folder is None else [folder / name for name in EARLY_STAGES]
        return [path for path in paths if path.exists()]  # without a relief it is not sought


def _early_settings(config: FitConfig) -> str:
    """All settings that clusters and found lobes depend on, as text."""
    values = with_lobe_limit(config).to_dict()
    later = LATER_SETTINGS | (set() if config.search.method == "stagewise" else {"stagewise"})
    kept = {key: value for key, value in values.items() if key not in later}
    return json.dumps({**kept, "coordinates": coordinate_count(config)})


def _totals(results: list[FitResult]) -> list[float]:
    return [result.report["seconds"]["total"] for result in results]


def _timed(results: list[FitResult], known: bool) -> TimedFit:
    stages = stage_medians([result.report for result in results])
    return TimedFit(results[-1], Timing(tuple(_totals(results))), stages, known)


def on_device(config: FitConfig, device: torch.device) -> FitConfig:
    """The settings on the device of the benchmark."""
    return config.override([f"device={device}"])
