"""Measured BRDFs and mean reflectances among the test data, as BTFs of one texel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.geometry.directions import direction_pairs, ring_directions
from tests.locations import data_file
from tests.planted.btfs import texel_btf

FOUR_LOBES = FitConfig.from_dict({"select": {"max_lobes": 4}})
# Weights and offsets of the networks that hold the measured BRDFs, layer by layer.
NETWORK = ("w1", "b1", "w2", "b2", "w3", "b3")


def measured_names() -> list[str]:
    """Names of the measured BRDFs."""
    with np.load(data_file("measured_brdfs.npz")) as file:
        return [str(name) for name in file["names"]]


def measured_brdf(name: str, directions: Tensor) -> Tensor:
    """Cosine-weighted values `[D, 3]` of a measured BRDF, from its small network, float64."""
    inputs, cosine = _network_inputs(*direction_pairs(directions, directions))
    return network_values(name, inputs) * cosine[:, None]


def network_values(name: str, inputs: Tensor) -> Tensor:
    """The measured BRDF `[D, 3]`, without a cosine, of what its network is fed with `[D, 6]`."""
    index = measured_names().index(name)
    with np.load(data_file("measured_brdfs.npz")) as file:
        layers = [torch.from_numpy(file[key][index]).to(inputs) for key in NETWORK]
    x = torch.relu(inputs @ layers[0] + layers[1])
    x = torch.relu(x @ layers[2] + layers[3])
    return (torch.exp(x @ layers[4] + layers[5]) - 1.0).clamp(min=0.0)


def brdf_btf(name: str, directions: Tensor) -> BTF:
    """A measured BRDF as a BTF of one texel."""
    return texel_btf(measured_brdf(name, directions)[None].float(), directions, name=name)


def measured_brdfs(every: int = 1) -> Iterator[tuple[str, BTF]]:
    """Measured BRDFs as BTFs of one texel."""
    directions = ring_directions()
    for name in measured_names()[::every]:
        yield name, brdf_btf(name, directions)


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


def measured_means() -> Iterator[tuple[str, BTF]]:
    """Measured mean reflectances as BTFs of one texel on 151 x 151 directions."""
    with np.load(data_file("measured_mean_reflectance.npz")) as file:
        directions = torch.from_numpy(file["direction"])
        for name in ("carpet07", "felt05"):
            values = torch.from_numpy(file[name]).flatten(0, 1)
            yield name, texel_btf(values[None].float(), directions, name=name)
