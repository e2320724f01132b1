"""A plane of one texture under a sun, seen slantwise by parallel rays, for renderers not ours."""

from __future__ import annotations

import argparse

import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import direction_from_angles
from tests.planted.models import planted_model

# Pixels of a side; distance of the camera; width of the picture, which a plane of side 1 fills.
SIZE, DISTANCE, WIDTH = 96, 3.0, 0.6
LIGHT, VIEW = (30.0, 200.0), (25.0, 60.0)


def add_model(parser: argparse.ArgumentParser) -> None:
    """Options that name a model: a run, or BRDFs of which one is planted."""
    parser.add_argument("run", nargs="?", help="run folder or model file")
    parser.add_argument(
        "--planted",
        action="append",
        choices=MODEL_NAMES,
        metavar="BRDF",
        help="in place of a run: 8 x 8 texels with lobes of this one; repeatable",
    )


def model_of(options: argparse.Namespace) -> SPMM:
    """The model that the options name."""
    if options.planted:
        return planted_model(names=tuple(options.planted))
    if options.run is None:
        raise SystemExit("no model is given; expected a run or --planted BRDF; name one.")
    return SPMM.load(options.run)


def light_and_view() -> tuple[Tensor, Tensor]:
    """Directions wi and wo, `[3]`."""
    radians = torch.deg2rad(torch.tensor((LIGHT, VIEW)))
    return direction_from_angles(*radians[0]), direction_from_angles(*radians[1])


def seen(camera: Tensor, wo: Tensor) -> Tensor:
    """Where the middle of each pixel of a camera `[4, 4]` meets the plane z = 0, `[S, S, 2]`."""
    step = ((torch.arange(SIZE) + 0.5) / SIZE - 0.5) * WIDTH
    y, x = torch.meshgrid(-step, step, indexing="ij")
    start = camera[:3, 3] + x[..., None] * camera[:3, 0] + y[..., None] * camera[:3, 1]
    return (start - (start[..., 2:] / wo[2]) * wo)[..., :2]


def told(name: str, found: Tensor, expected: Tensor) -> str:
    """A line with the relative error of a picture."""
    error = float((found - expected).norm() / expected.norm())
    return f"{name}: relative error {100.0 * error:.2f} %"
