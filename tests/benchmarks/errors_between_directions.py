"""Measured BRDFs between directions: `python -m tests.benchmarks.errors_between_directions`.

Of all 159, as `tests/hard/brdfs.py` judges them; `--every N` takes every N-th, `--only NAME` one,
and with `--dense` they are fit at 151 x 151 directions. Needs the test data.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np
import torch

from spmm_torch import SPMM
from spmm_torch.geometry.directions import direction_pairs, ring_directions
from tests.hard.brdfs import COARSE, DENSE, FACTOR, Directions, Figure, figure, fitted
from tests.measured import FOUR_LOBES, measured_brdf, measured_names


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
