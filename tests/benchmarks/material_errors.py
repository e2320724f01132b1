"""Prints the figures that the README and the changelog quote: `python tests/figures.py NAME ...`.

NAME is one of: materials (the path-traced zips), brdfs (159 measured BRDFs), means (two measured
mean reflectances), planted (mixtures made here). The first three need the test data beside the
repository, see `shared_data`; `--every N` takes every N-th BRDF.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spmm_torch import BTF, FitConfig, load_btf
from spmm_torch.fit import fit
from spmm_torch.geometry.directions import direction_pairs, ring_directions
from spmm_torch.lobes.batch import COORDINATES, LobeBatch, decode

FOUR_LOBES = FitConfig.from_dict({"select": {"max_lobes": 4}})
# Weights and offsets of the networks that hold the measured BRDFs, layer by layer.
NETWORK = ("w1", "b1", "w2", "b2", "w3", "b3")
MATERIALS = ("ROCKS64", "MOSS64", "TILES64", "WEAVE64")


def shared_data() -> Path:
    """Where the test data lie that cannot be in the repository."""
    return Path(__file__).parents[2] / "shared" / "data"


def measured_names() -> list[str]:
    """Names of the measured BRDFs."""
    with np.load(shared_data() / "measured_brdfs.npz") as file:
        return [str(name) for name in file["names"]]


def measured_brdf(name: str, directions: Tensor) -> Tensor:
    """Cosine-weighted values `[D, 3]` of a measured BRDF, from its small network, float64."""
    index = measured_names().index(name)
    with np.load(shared_data() / "measured_brdfs.npz") as file:
        layers = [torch.from_numpy(file[key][index]).double() for key in NETWORK]
    inputs, cosine = _network_inputs(*direction_pairs(directions, directions))
    x = torch.relu(inputs @ layers[0] + layers[1])
    x = torch.relu(x @ layers[2] + layers[3])
    value = (torch.exp(x @ layers[4] + layers[5]) - 1.0).clamp(min=0.0)
    return value * cosine[:, None]


def measured_brdfs(every: int = 1) -> Iterator[tuple[str, BTF]]:
    """Measured BRDFs as BTFs of one texel."""
    directions = ring_directions()
    for name in measured_names()[::every]:
        yield name, one_texel(measured_brdf(name, directions), directions, name)


def _network_inputs(wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """What the networks are fed with `[D, 6]`, and the cosine of the light `[D]`."""
    wi, wo = wi.double(), wo.double()
    h = torch.nn.functional.normalize(wi + wo, dim=-1)
    theta, phi = torch.arccos(h[:, 2].clamp(-1.0, 1.0)), torch.atan2(h[:, 1], h[:, 0])
    turned_x = phi.cos() * wi[:, 0] + phi.sin() * wi[:, 1]
    turned_y = phi.cos() * wi[:, 1] - phi.sin() * wi[:, 0]
    d_x = theta.cos() * turned_x - theta.sin() * wi[:, 2]
    d_z = theta.sin() * turned_x + theta.cos() * wi[:, 2]
    zero = torch.zeros_like(theta)
    inputs = torch.stack((theta.sin(), zero, theta.cos(), d_x, turned_y, d_z), dim=-1)
    return inputs, wi[:, 2]


def one_texel(values: Tensor, directions: Tensor, name: str) -> BTF:
    """A BTF of one texel of `values [D, 3]`."""
    count = len(directions)
    return BTF.from_values(
        values.float().view(count, count, 1, 1, 3), directions, directions, name=name
    )


def measured_means() -> Iterator[tuple[str, BTF]]:
    """Measured mean reflectances as BTFs of one texel on 151 x 151 directions."""
    with np.load(shared_data() / "measured_mean_reflectance.npz") as file:
        directions = torch.from_numpy(file["direction"])
        for name in ("carpet07", "felt05"):
            values = torch.from_numpy(file[name]).flatten(0, 1)
            yield name, one_texel(values, directions, name)


def planted(
    side: int, palettes: int, seed: int, directions: Tensor | None = None
) -> tuple[BTF, float]:
    """A BTF made of known mixtures, 1 to 4 lobes of any model a texel, and their mean number.

    Each palette is a mixture of its own; texels of a palette differ in all weights and colours.
    """
    generator = torch.Generator().manual_seed(seed)
    directions = ring_directions() if directions is None else directions
    texels = side * side
    palette = torch.randint(palettes, (texels,), generator=generator)
    count = torch.randint(1, 5, (palettes,), generator=generator)
    values = torch.zeros(texels, len(directions) ** 2, 3)
    for index in range(palettes):
        lobes = _random_lobes(int(count[index]), generator)
        rho = lobes.eval_grid(directions, directions)
        rho = rho / rho.norm(dim=1, keepdim=True)
        own = torch.nonzero(palette == index).squeeze(1)
        weights = 0.1 + 0.9 * torch.rand(len(own), len(lobes), 3, generator=generator)
        values[own] = torch.einsum("njc,jd->ndc", weights, 10.0 * rho)
    size = (side, side, len(directions), len(directions), 3)
    pictures = values.view(size).permute(2, 3, 0, 1, 4)
    btf = BTF.from_values(pictures.contiguous(), directions, directions, name=f"planted{seed}")
    return btf, float(count[palette].float().mean())


def _random_lobes(count: int, generator: torch.Generator) -> LobeBatch:
    """Lobes of any of the seven models, tilted up to 45 degrees, neither flat nor needles."""
    model = torch.randint(7, (count,), generator=generator)
    coordinates = torch.rand(count, COORDINATES, generator=generator)
    coordinates[:, :2] -= 0.5
    coordinates[:, 2] *= torch.pi
    coordinates[:, 3:] = 0.25 + 0.5 * coordinates[:, 3:]
    return decode(model, coordinates)


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
            show(name, load_btf(shared_data() / f"{name}.zip"), FitConfig())
    if "brdfs" in options.names:
        snr = [show(name, btf, FOUR_LOBES) for name, btf in measured_brdfs(options.every)]
        print(f"{len(snr)} BRDFs: median {np.median(snr):.2f} dB, ", end="")
        print(f"lowest tenth {np.quantile(snr, 0.1):.2f} dB")
    if "means" in options.names:
        for name, btf in measured_means():
            show(name, btf, FOUR_LOBES)
    if "planted" in options.names:
        for seed in range(3):
            btf, truth = planted(16, 8, seed)
            show(f"planted {seed}, {truth:.2f} lobes a texel", btf, FitConfig())


if __name__ == "__main__":
    main()
