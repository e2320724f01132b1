"""How long each edit takes without a mask: `python -m tests.benchmarks.edits [--threads 2]`.

Of a planted model of 256 x 256 texels with 8 lobes each, or of a run with --run RUN; median
milliseconds of some calls after one that warms up.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch

from spmm_torch import SPMM
from spmm_torch.edit import (
    Rectangle,
    Stripes,
    blend,
    change_table,
    copy_look,
    hue_saturation,
    intensity,
    lobe_group,
    replace_model,
    residual_strength,
    rotate_tangent,
    scale_width,
    select_texels,
    set_parameter,
    spread_normals,
)
from tests.planted.models import planted_model

TEXELS, LOBES, CLUSTERS, CLUSTER_LOBES = 256, 8, 32, 24
BOUND = 0.05  # seconds that an edit without a mask may take


def edits_of(model: SPMM) -> dict[str, Callable[[], SPMM]]:
    """Every edit by its name."""
    other, specular = intensity(model, 0.5), lobe_group(model, "specular")
    return {
        "intensity": lambda: intensity(model, 1.5),
        "intensity, specular": lambda: intensity(model, 1.5, specular),
        "hue_saturation": lambda: hue_saturation(model, 1.0, 0.8),
        "hue_saturation, more saturated": lambda: hue_saturation(model, 1.0, 1.5),
        "hue_saturation, unit": lambda: hue_saturation(model, 1.0, 0.8, fit="unit"),
        "hue_saturation, specular": lambda: hue_saturation(model, 1.0, 0.8, specular),
        "scale_width": lambda: scale_width(model, 0.5, specular),
        "scale_width, energy kept": lambda: scale_width(model, 0.5, specular, keep_energy=True),
        "spread_normals": lambda: spread_normals(model, 1.5),
        "rotate_tangent": lambda: rotate_tangent(model, 0.5),
        "set_parameter": lambda: set_parameter(model, "f0", 0.5),
        "replace_model, specular": lambda: replace_model(model, "ward", specular),
        "residual_strength": lambda: residual_strength(model, 0.5),
        "blend": lambda: blend(model, other, 0.5),
        "copy_look": lambda: copy_look(model, Rectangle(0, 0, 64, 64)),
    }


def masked_edits_of(model: SPMM) -> dict[str, Callable[[], SPMM]]:
    """Some edits under a soft mask, and a copied region; no bound is set for them."""
    where = select_texels(model, Stripes(4, 0.5, 0.1).mask(model))
    return {
        "intensity, soft mask": lambda: intensity(model, 1.5, where),
        "hue_saturation, soft mask": lambda: hue_saturation(model, 1.0, 0.8, where),
        "spread_normals, soft mask": lambda: spread_normals(model, 1.5, where),
        "copy_look, soft mask": lambda: copy_look(model, Rectangle(0, 0, 64, 64), where),
    }


def median_time(work: Callable[[], object], repeats: int) -> float:
    """Median seconds of `repeats` calls, after one that warms up."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    if options.run:
        model = SPMM.load(options.run)
    else:
        model = planted_model(TEXELS, LOBES, CLUSTERS, CLUSTER_LOBES, residual=0.01)
    start = time.perf_counter()
    change_table()
    print(f"{'table of 10,000 changes, once':34}{time.perf_counter() - start:8.2f} s")
    for name, work in edits_of(model).items():
        seconds = median_time(work, options.repeats)
        print(f"{name:34}{1e3 * seconds:8.1f} ms{'' if seconds <= BOUND else '  above the bound'}")
    for name, work in masked_edits_of(model).items():
        print(f"{name:34}{1e3 * median_time(work, options.repeats):8.1f} ms")


if __name__ == "__main__":
    main()
