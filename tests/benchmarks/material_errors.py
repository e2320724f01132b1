"""Errors of the fits of materials: `python -m tests.benchmarks.material_errors NAME ...`.

NAME is one of: materials (the path-traced zips), brdfs (159 measured BRDFs), means (two measured
mean reflectances), planted (mixtures made here). The first three need the test data, see
`tests/locations.py`; `--every N` takes every N-th BRDF.
"""

from __future__ import annotations

import argparse

import numpy as np

from spmm_torch import BTF, FitConfig, load_btf
from spmm_torch.fit import fit
from tests.locations import data_file
from tests.measured import FOUR_LOBES, measured_brdfs, measured_means
from tests.planted.palettes import strewn_palettes

MATERIALS = ("ROCKS64", "MOSS64", "TILES64", "WEAVE64")


def show(name: str, btf: BTF, config: FitConfig) -> float:
    """Fits and prints a row; returns the SNR without residual."""
    report = fit(btf, config).report
    snr = report["snr_db"]
    print(
        f"{name:<28} SNR {snr['without_residual']:6.2f} dB, with residual "
        f"{snr['with_residual']:6.2f} dB, cluster mean {snr['cluster_mean']:6.2f} dB, "
        f"{report['mean_basis_per_texel']:5.2f} lobes a texel, "
        f"{report['seconds']['total']:6.1f} s, {report['peak_memory_bytes'] / 2**20:5.0f} MB",
        flush=True,
    )
    return snr["without_residual"]


def main() -> None:
    """Prints what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="+", choices=("materials", "brdfs", "means", "planted"))
    parser.add_argument("--every", type=int, default=1, help="every N-th BRDF")
    options = parser.parse_args()
    if "materials" in options.names:
        for name in MATERIALS:
            show(name, load_btf(data_file(f"{name}.zip")), FitConfig())
    if "brdfs" in options.names:
        snr = [show(name, btf, FOUR_LOBES) for name, btf in measured_brdfs(options.every)]
        print(f"{len(snr)} BRDFs: median {np.median(snr):.2f} dB, ", end="")
        print(f"lowest tenth {np.quantile(snr, 0.1):.2f} dB")
    if "means" in options.names:
        for name, btf in measured_means():
            show(name, btf, FOUR_LOBES)
    if "planted" in options.names:
        for seed in range(3):
            btf, truth = strewn_palettes(16, 8, seed)
            show(f"planted {seed}, {truth:.2f} lobes a texel", btf, FitConfig())


if __name__ == "__main__":
    main()
