"""Four times the texels take hardly more memory where the values do not fit in what is allowed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.geometry.directions import ring_directions
from tests.locations import ROOT

DIRECTIONS = ring_directions(((0.0, 1), (25.0, 8), (50.0, 12), (70.0, 16))).numpy()
SIDE = 64
GROWTH = 1.15
# Blocks are made small, as texels are fewer here than blocks are wide. The fit may then take what
# its stages need, and SPARE bytes for data: less than those of the smaller BTF.
SPARE = 16_000_000
# Whatever is larger than a megabyte goes back to the system once it is freed: what the heap keeps
# for later would hide what the program holds.
NO_HEAP = {"MALLOC_MMAP_THRESHOLD_": f"{1 << 20}", "MALLOC_TRIM_THRESHOLD_": f"{1 << 20}"}
FIT = f"""
import sys, torch
from spmm_torch import FitConfig, load_btf
from spmm_torch.cli.main import main
from spmm_torch.data import blocks
from spmm_torch.fit import pipeline, plan, stage_memory
from spmm_torch.fit.search import joint
from spmm_torch.fit.select import alternate, clusters

blocks.CPU_BLOCK_VALUES = 1 << 20
for module in (joint, stage_memory):
    module.CPU_JACOBIAN_VALUES = 1 << 20
for module in (alternate, clusters, stage_memory):
    module.CPU_TEXELS = 1 << 8
source, run, cache, settings = sys.argv[1:]
config = FitConfig.from_yaml(settings).override(["device=cpu"])
for _ in range(2):  # the first one loads what every process needs
    needed = plan.estimate(load_btf(source), config, torch.device("cpu")).working_bytes
limit = f"--max-memory={{needed + {SPARE}}}"
command = ["fit", source, "-o", run, "--cache", cache, "--config", settings, "--device=cpu", limit]
sys.exit(main(command))
"""


def write_btf(path: Path, side: int) -> int:
    """Rough glossy texels of four materials; returns the size of their values in bytes."""
    generator = np.random.default_rng(0)
    label = generator.integers(0, 4, (side, side))
    albedo = generator.random((4, 3), dtype=np.float32)[label]  # [H, W, 3]
    exponent = np.float32([2, 10, 40, 5])[label][..., None]
    rough = 0.5 + 0.5 * generator.random((side, side, 1), dtype=np.float32)
    count = len(DIRECTIONS)
    values = np.empty((count, count, side, side, 3), np.float16)
    for view, light in np.ndindex(count, count):
        half = DIRECTIONS[view] + DIRECTIONS[light]
        gloss = (half[2] / np.linalg.norm(half)) ** exponent
        values[view, light] = 0.5 * DIRECTIONS[light, 2] * rough * (albedo + gloss)
    np.savez(path, values=values, view=DIRECTIONS, light=DIRECTIONS)
    return values.nbytes


@pytest.mark.slow
def test_peak_memory_is_flat(tmp_path: Path) -> None:
    (tmp_path / "driver.py").write_text(FIT, encoding="utf-8")
    peaks, sizes = [], []
    for side in (SIDE, 2 * SIDE):
        source, run = tmp_path / f"{side}.npz", tmp_path / f"run{side}"
        cache = tmp_path / f"cache{side}"
        sizes.append(write_btf(source, side))
        arguments = [str(part) for part in (source, run, cache, "configs/smoke.yaml")]
        process = subprocess.run(
            [sys.executable, str(tmp_path / "driver.py"), *arguments],
            cwd=ROOT,
            env={**os.environ, "OMP_NUM_THREADS": "1", **NO_HEAP},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert process.returncode == 0, process.stderr
        assert sum(path.stat().st_size for path in cache.glob("*.npy")) > sizes[-1]
        report = json.loads((run / "report.json").read_text(encoding="utf-8"))
        assert report["texels"] == side * side
        peaks.append(report["peak_memory_bytes"])
    assert sizes[0] > SPARE
    assert peaks[0] + sizes[1] - sizes[0] > GROWTH * peaks[0]  # in memory it would show
    assert peaks[1] < GROWTH * peaks[0], peaks
