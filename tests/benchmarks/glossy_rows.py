"""Rows of albedo and of the body among those of samples: `python -m tests.benchmarks.glossy_rows`.

The lobes that fits of measured glossy materials found, 81 x 81 directions, with weights solved anew
by non-negative least squares: beside the samples stands the white-sky reflectance of each of five
views, here the true one, with so many times the energy of the samples; or pairs at half angles over
25 degrees count more. `--only NAME` takes one. Needs the test data.
"""

from __future__ import annotations

import argparse
import math

import torch
from scipy.optimize import nnls
from torch import Tensor

from spmm_torch.fit import fit
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.weighting import compressive_weights
from spmm_torch.lobes.batch import LobeBatch
from tests.benchmarks.glossy_materials import row
from tests.glossy import (
    ALBEDO_ANGLES,
    BODY,
    FOUR_LOBES,
    Material,
    Value,
    albedo,
    figures,
    material,
    of_model,
)

NAMES = ("ilm_solo_m_68", "chm_orange", "irid_flake_paint1")
# Energy of the rows of albedo over that of the samples, and factor of the weights of the body.
SOLVES = ((0.0, 1.0), (0.1, 1.0), (1.0, 1.0), (100.0, 1.0), (0.0, 4.0), (0.0, 16.0))


def mixture(lobes: LobeBatch, weights: Tensor) -> Value:
    """The values of lobes with weights `[M, 3]`."""

    def value(wi: Tensor, wo: Tensor) -> Tensor:
        return torch.einsum("mc,md->dc", weights, lobes.eval(wi[None], wo[None]).double())

    return value


def albedos(lobes: LobeBatch) -> Tensor:
    """White-sky reflectance of each lobe at `ALBEDO_ANGLES`, `[M, 5]`."""
    rows = []
    for theta in ALBEDO_ANGLES:
        polar = math.radians(theta)
        wo = torch.tensor([math.sin(polar), 0.0, math.cos(polar)])
        one = torch.ones(1, 3).double()
        each = [mixture(lobes[index : index + 1], one) for index in range(len(lobes))]
        rows.append(torch.stack([albedo(value, wo)[0] for value in each]))
    return torch.stack(rows, dim=1)


def solved(
    own: Material, lobes: LobeBatch, weight: Tensor, reflected: Tensor, share: float, body: float
) -> Value:
    """The lobes with the weights of one solve; `weight [D]` of pairs, `reflected [M, 5]`."""
    wi, wo = own.pairs
    half = torch.nn.functional.normalize(wi + wo, dim=1)
    far = half[:, 2] < math.cos(math.radians(BODY))
    scale = torch.where(far, body * weight, weight).sqrt()
    rho = lobes.eval(wi[None], wo[None]).double() * scale
    found = []
    for signal, truth in zip((own.samples.double() * scale[:, None]).T, own.albedo.T, strict=True):
        factor = (share * signal.square().sum() / len(truth)).sqrt() / truth.double()
        system = torch.cat((rho, reflected * factor), dim=1).T
        wanted = torch.cat((signal, truth.double() * factor))
        found.append(torch.from_numpy(nnls(system.numpy(), wanted.numpy())[0]))
    return mixture(lobes, torch.stack(found, dim=1))


def main() -> None:
    """Prints a row for each solve."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", metavar="NAME", help="this one; repeatable")
    for name in parser.parse_args().only or NAMES:
        own = material(name, 81)
        btf = own.btf()
        model = fit(btf, FOUR_LOBES, render=False).model
        print(row(f"{name}, lobes", figures(own, of_model(model, residual=False))), flush=True)
        lobes, cpu = model.dictionary.detach(), torch.device("cpu")
        objective = Objective.of(btf, FOUR_LOBES, cpu)
        weight = compressive_weights(btf, objective, cpu).pair
        assert weight is not None
        reflected = albedos(lobes)
        for share, body in SOLVES:
            value = solved(own, lobes, weight.double(), reflected, share, body)
            print(row(f"albedo {share:g}, body {body:g}", figures(own, value)), flush=True)


if __name__ == "__main__":
    main()
