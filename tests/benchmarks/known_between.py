"""What is known of measured BRDFs between directions: `python -m tests.benchmarks.known_between`.

Two bounds for `errors_between_directions`: the samples alone, interpolated smoothly, without any
lobe; and with `--both` four lobes that are fit by squared errors to the pairs between as well.
`--every N` takes every N-th BRDF, `--only NAME` one. Needs the test data.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
import torch
from scipy.interpolate import RBFInterpolator
from torch import Tensor

from spmm_torch.fit import fit
from spmm_torch.geometry.directions import angular_spacing, direction_pairs, ring_directions
from spmm_torch.metrics import snr_db
from tests.hard.brdfs import COARSE
from tests.measured import FOUR_LOBES, brdf_btf, measured_brdf, measured_names

# Added to values, whose logarithms are interpolated.
DARK = 1e-4
# Samples from which a pair is told.
NEIGHBOURS = 60
ON, BETWEEN = (ring_directions(rings) for rings in (COARSE.measured, COARSE.between))


def places(directions: Tensor) -> np.ndarray:
    """Where pairs of an isotropic, reciprocal material lie, `[D, 3]`.

    These are the half angle, with more room near the mirror direction, the difference angle, and
    how far light and view leave the plane of the half vector.
    """
    wi, wo = (part.double() for part in direction_pairs(directions, directions))
    h = torch.nn.functional.normalize(wi + wo, dim=1)
    half = torch.arccos(h[:, 2].clamp(-1.0, 1.0))
    difference = torch.arccos((h * wi).sum(1).clamp(-1.0, 1.0))
    azimuth = torch.atan2(h[:, 1], h[:, 0])
    along = azimuth.cos() * wi[:, 0] + azimuth.sin() * wi[:, 1]
    across = azimuth.cos() * wi[:, 1] - azimuth.sin() * wi[:, 0]
    turn = torch.atan2(across, half.cos() * along - half.sin() * wi[:, 2])
    lean = (2.0 * turn).cos() * half.sin() * difference.sin()
    return torch.stack((4.0 * (half / (0.5 * math.pi)).sqrt(), 2.0 * difference, lean), 1).numpy()


def smooth(samples: Tensor) -> Tensor:
    """Values between `[D, 3]` of those on the samples, by cubic radial functions of logarithms."""
    known, wanted = places(ON), places(BETWEEN)
    _, first, same = np.unique(known.round(5), axis=0, return_index=True, return_inverse=True)
    view = direction_pairs(ON, ON)[1][:, 2:].double()
    logarithm = (samples * view + DARK).log().numpy()
    mean = np.zeros((len(first), logarithm.shape[1]))
    np.add.at(mean, same.ravel(), logarithm)
    mean /= np.bincount(same.ravel())[:, None]
    told = RBFInterpolator(known[first], mean, kernel="cubic", smoothing=1e-6, neighbors=NEIGHBOURS)
    found = torch.from_numpy(np.exp(told(wanted))) - DARK
    return found / direction_pairs(BETWEEN, BETWEEN)[1][:, 2:].double()


def of_both(name: str) -> Tensor:
    """Values between `[D, 3]` of lobes that saw these, too."""
    every = torch.cat((ON, BETWEEN))
    width = FOUR_LOBES.search.min_width * angular_spacing(ON) / angular_spacing(every)
    config = FOUR_LOBES.override([f"search.min_width={width}", "weights.error=l2"])
    model = fit(brdf_btf(name, every), config, render=False).model
    wi, wo = direction_pairs(BETWEEN, BETWEEN)
    with torch.no_grad():
        return model(torch.full((len(wi), 2), 0.5), wi, wo, residual=False).double()


def main() -> None:
    """Prints a row for each BRDF, and the median."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="every N-th BRDF")
    parser.add_argument("--only", action="append", metavar="NAME", help="this one; repeatable")
    parser.add_argument("--both", action="store_true", help="lobes that see the pairs between, too")
    options = parser.parse_args()
    rows = []
    for name in options.only or measured_names()[:: options.every]:
        truth = measured_brdf(name, BETWEEN)
        found = of_both(name) if options.both else smooth(measured_brdf(name, ON))
        error = float((found - truth).square().sum())
        rows.append(snr_db(float(truth.square().sum()), error))
        print(f"{name:<36} between {rows[-1]:6.2f} dB", flush=True)
    print(f"{len(rows)} BRDFs, median between {np.median(rows):.2f} dB")


if __name__ == "__main__":
    main()
