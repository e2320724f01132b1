"""Measured BRDFs between the directions on which they were fit.

Fit at 81 x 81 directions and judged at the rings that UBO2014's 151 directions have between those,
72 x 72 pairs with mirror directions of their own; with `--dense` fit at 151 x 151 directions and
judged at 150 x 150 on rings halfway between. Figures are of all: `python -m tests.hard.brdfs`;
`--every N` takes every N-th, `--only NAME` one.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.fit import FitResult, fit
from spmm_torch.geometry.directions import (
    UBO2003_RINGS,
    UBO2014_RINGS,
    direction_pairs,
    ring_directions,
)
from spmm_torch.metrics import snr_db
from spmm_torch.render.btf_material import BTFMaterial
from tests.benchmarks.material_errors import FOUR_LOBES, measured_brdf, measured_names, one_texel

# The relative error between samples may be this many times that on samples.
FACTOR = 2.0
Rings = tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class Directions:
    """Rings of directions: on which a BRDF is measured, and between them."""

    measured: Rings
    between: Rings


def _between(rings: Rings) -> Rings:
    """Rings halfway between those given, with as many directions as the outer of both."""
    return tuple((0.5 * (inner[0] + outer[0]), outer[1]) for inner, outer in pairwise(rings))


_COARSE = {polar for polar, _ in UBO2003_RINGS}
COARSE = Directions(UBO2003_RINGS, tuple(ring for ring in UBO2014_RINGS if ring[0] not in _COARSE))
DENSE = Directions(UBO2014_RINGS, _between(UBO2014_RINGS))


@dataclass(frozen=True)
class Figure:
    """SNR in dB of the fit of one BRDF.

    Attributes:
        on_samples: of the lobes.
        between: of the lobes, between the samples.
        whole: of lobes and residual, which is interpolated, between the samples.
        interpolated: of the samples themselves, interpolated in the same way.
    """

    name: str
    on_samples: float
    between: float
    whole: float
    interpolated: float

    @property
    def ratio(self) -> float:
        """Relative error (root mean square) between samples over that on samples."""
        return 10.0 ** ((self.on_samples - self.between) / 20.0)


def fitted(
    name: str, config: FitConfig = FOUR_LOBES, directions: Directions = COARSE
) -> tuple[BTF, FitResult]:
    """One BRDF on the measured directions, and its fit."""
    measured = ring_directions(directions.measured)
    btf = one_texel(measured_brdf(name, measured), measured, name)
    return btf, fit(btf, config)


def figure(btf: BTF, result: FitResult, directions: Directions = COARSE) -> Figure:
    """Looks between the measured directions of a BRDF."""
    between = ring_directions(directions.between)
    wi, wo = direction_pairs(between, between)
    truth, uv = measured_brdf(btf.name, between), torch.full((len(wi), 2), 0.5)

    def snr(found: Tensor) -> float:
        error = float((found.double() - truth).square().sum())
        return snr_db(float(truth.square().sum()), error)

    with torch.no_grad():
        return Figure(
            btf.name,
            result.report["snr_db"]["without_residual"],
            snr(result.model(uv, wi, wo, residual=False)),
            snr(result.model(uv, wi, wo)),
            snr(BTFMaterial.build(btf)(uv, wi, wo)),
        )


def peaks(name: str, model: SPMM, directions: Directions) -> Iterator[str]:
    """Mirror peaks of one BRDF by polar angle, and what share of the squared error is theirs."""
    for where, rings in (("measured", directions.measured), ("between", directions.between)):
        own = ring_directions(rings)
        wi, wo = direction_pairs(own, own)
        truth = measured_brdf(name, own)
        with torch.no_grad():
            found = model(torch.full((len(wi), 2), 0.5), wi, wo, residual=False)
        error = (found - truth).square().sum(1)
        mirror = torch.isclose(wi * torch.tensor([-1.0, -1.0, 1.0]), wo, atol=1e-4).all(1)
        for polar, _ in rings:
            here = mirror & torch.isclose(wi[:, 2], torch.tensor(math.cos(math.radians(polar))))
            yield (
                f"  {where:<8} {polar:5.2f} degrees: truth {float(truth[here].mean()):9.4f}, lobes "
                f"{float(found[here].mean()):9.4f}, {float(error[here].sum() / error.sum()):4.0%} "
                f"of the error"
            )


def main() -> None:
    """Prints a row for each BRDF, and how many exceed the factor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="every N-th BRDF")
    parser.add_argument("--only", action="append", metavar="NAME", help="this one; repeatable")
    parser.add_argument("--dense", action="store_true", help="fit at 151 x 151 directions")
    parser.add_argument("--peaks", action="store_true", help="mirror peaks by polar angle, too")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    names = options.only or measured_names()[:: options.every]
    directions = DENSE if options.dense else COARSE
    config, rows = FOUR_LOBES.override(options.set), []
    for name in names:
        btf, result = fitted(name, config, directions)
        row = figure(btf, result, directions)
        rows.append(row)
        print(
            f"{row.name:<36} on samples {row.on_samples:6.2f} dB, between {row.between:6.2f} dB, "
            f"error {row.ratio:5.2f} times, with residual {row.whole:6.2f} dB, samples "
            f"interpolated {row.interpolated:6.2f} dB",
            flush=True,
        )
        for line in peaks(name, result.model, directions) if options.peaks else ():
            print(line)
    for line in summary(rows):
        print(line)


def summary(rows: list[Figure]) -> list[str]:
    """What the rows say together."""
    on_samples = np.array([row.on_samples for row in rows])
    between = np.array([row.between for row in rows])
    whole = np.array([row.whole for row in rows])
    interpolated = np.array([row.interpolated for row in rows])
    ratio = np.array([row.ratio for row in rows])
    return [
        f"{len(rows)} BRDFs, medians: on samples {np.median(on_samples):.2f} dB (lowest tenth "
        f"{np.percentile(on_samples, 10):.2f}), between {np.median(between):.2f} dB, with residual "
        f"{np.median(whole):.2f} dB, samples interpolated {np.median(interpolated):.2f} dB",
        f"error between samples: median {np.median(ratio):.2f} times, above {FACTOR:g} times for "
        f"{(ratio > FACTOR).sum()}",
        f"nearer to the truth between samples than samples interpolated: lobes alone "
        f"{(between > interpolated).sum()}, with residual {(whole > interpolated).sum()}",
    ]


if __name__ == "__main__":
    main()
