"""A folder of MERL tables: `python -m tests.benchmarks.merl_folder FOLDER`, for `spmm fit FOLDER`.

The 100 materials of MERL among the measured BRDFs, from their networks, in the database's own
format, 33 MB each; `--count N` makes the first N. Needs the test data.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch

from spmm_torch.data.brdf_tables import merl
from tests.measured import measured_names, network_values


def cell_inputs() -> torch.Tensor:
    """What the networks are fed with in the middle of each cell, `[90 90 180, 6]` float64."""
    half, difference, azimuth = (
        (torch.arange(count, dtype=torch.float64) + 0.5) / count for count in merl.CELLS
    )
    theta, delta, phi = torch.meshgrid(
        0.5 * math.pi * half.square(), 0.5 * math.pi * difference, math.pi * azimuth, indexing="ij"
    )
    x, y = delta.sin() * phi.cos(), delta.sin() * phi.sin()
    inputs = (theta.sin(), torch.zeros_like(theta), theta.cos(), x, y, delta.cos())
    return torch.stack(inputs, dim=-1).flatten(0, 2)


def main() -> None:
    """Writes the tables, and prints their names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, help="number of materials (default: all)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    inputs = cell_inputs().float()
    names = [name for name in measured_names() if name.startswith("merl/")]
    for name in names[: options.count]:
        values = network_values(name, inputs).double().numpy() / merl.SCALE
        table = np.ascontiguousarray(values.T).astype("<f8").tobytes()
        path = options.folder / f"{Path(name).name}{merl.SUFFIX}"
        path.write_bytes(merl.HEADER + table)
        print(path, flush=True)


if __name__ == "__main__":
    main()
