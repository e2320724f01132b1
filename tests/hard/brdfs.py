"""Measured BRDFs between the directions on which they were fit.

Fit at 81 x 81 directions; judged at the rings that UBO2014's 151 directions have between those,
72 x 72 pairs with mirror directions of their own. Figures are of all: `python -m tests.hard.brdfs`;
`--every N` takes every N-th, `--only NAME` one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from spmm_torch import FitConfig
from spmm_torch.fit import fit
from spmm_torch.geometry import UBO2003_RINGS, UBO2014_RINGS, direction_pairs, ring_directions
from spmm_torch.metrics import snr_db
from tests.figures import FOUR_LOBES, measured_brdf, measured_names, one_texel

MEASURED = {polar for polar, _ in UBO2003_RINGS}
BETWEEN = ring_directions(tuple(ring for ring in UBO2014_RINGS if ring[0] not in MEASURED))
# The relative error between samples may be this many times that on samples.
FACTOR = 2.0


@dataclass(frozen=True)
class Figure:
    """SNR in dB of the lobes of one BRDF, on the samples and between them."""

    name: str
    on_samples: float
    between: float

    @property
    def ratio(self) -> float:
        """Relative error (root mean square) between samples over that on samples."""
        return 10.0 ** ((self.on_samples - self.between) / 20.0)


def figure(name: str, config: FitConfig = FOUR_LOBES) -> Figure:
    """Fits one BRDF on the measured directions and looks between them."""
    directions = ring_directions()
    result = fit(one_texel(measured_brdf(name, directions), directions, name), config)
    wi, wo = direction_pairs(BETWEEN, BETWEEN)
    truth = measured_brdf(name, BETWEEN)
    with torch.no_grad():
        found = result.model(torch.full((len(wi), 2), 0.5), wi, wo, residual=False)
    error = float((found.double() - truth).square().sum())
    snr = snr_db(float(truth.square().sum()), error)
    return Figure(name, result.report["snr_db"]["without_residual"], snr)


def figures(names: list[str], config: FitConfig = FOUR_LOBES) -> Iterator[Figure]:
    """The figures of several BRDFs."""
    return (figure(name, config) for name in names)


def main() -> None:
    """Prints a row for each BRDF, and how many exceed the factor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="every N-th BRDF")
    parser.add_argument("--only", action="append", metavar="NAME", help="this one; repeatable")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    names = options.only or measured_names()[:: options.every]
    rows = []
    for row in figures(names, FOUR_LOBES.override(options.set)):
        rows.append(row)
        print(
            f"{row.name:<36} on samples {row.on_samples:6.2f} dB, between {row.between:6.2f} dB, "
            f"error {row.ratio:5.2f} times",
            flush=True,
        )
    ratio = np.array([row.ratio for row in rows])
    print(
        f"{len(rows)} BRDFs: on samples median {np.median([row.on_samples for row in rows]):.2f} "
        f"dB, between {np.median([row.between for row in rows]):.2f} dB; error between samples "
        f"median {np.median(ratio):.2f} times, above {FACTOR:g} times for {(ratio > FACTOR).sum()}"
    )


if __name__ == "__main__":
    main()
