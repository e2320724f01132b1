"""Inputs that are hard to fit, made here, each with the least accuracy that is promised for it.

`tests/hard/test_bounds.py` holds every case to its bound; `python -m tests.benchmarks.hard_cases`
prints what is reached; `docs/hard_cases.md` shows both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.fit import FitResult, fit
from spmm_torch.geometry.directions import direction_from_angles, direction_pairs, ring_directions
from spmm_torch.metrics import snr_db
from tests.planted.btfs import texel_btf
from tests.planted.lobes import Lobe, lobe_batch
from tests.planted.settings import FLAT

# 31 directions, 20 degrees apart, and five rings of ten that reach the horizon.
COARSE = ring_directions(((0.0, 1), (20.0, 6), (40.0, 10), (60.0, 14)))
GRAZING = ring_directions(((0.0, 1), (30.0, 8), (60.0, 8), (80.0, 10), (87.0, 10)))
QUICK = {
    **FLAT,
    "cluster": {"count": 4},
    "search": {"max_lobes": 3, "exchanges": 3, "restarts": 4},
    "device": "cpu",
}
# Directions between the measured ones, at which planted truths are compared too.
BETWEEN = 2000
STEEPEST = 60.0


@dataclass(frozen=True)
class Planted:
    """A sum of lobes of given weights `[J, 3]`; a function of directions."""

    lobes: tuple[Lobe, ...]
    weights: tuple[tuple[float, float, float], ...]

    def __call__(self, wi: Tensor, wo: Tensor) -> Tensor:
        """Values `[Q, 3]` at wi and wo `[Q, 3]`, float64."""
        lobes = lobe_batch(*self.lobes, dtype=torch.float64)
        rho = lobes.eval(wi.double()[None], wo.double()[None])  # [J, Q]
        return rho.T @ torch.tensor(self.weights, dtype=torch.float64)


def texture(
    texels: list[Tensor],
    directions: Tensor,
    name: str,
    negative: str = "refuse",
    dtype: torch.dtype = torch.float32,
) -> BTF:
    """A BTF one texel high of values `[D, 3]` each."""
    return texel_btf(torch.stack(texels).to(dtype), directions, name=name, negative=negative)


def planted_texture(truths: list[Planted], directions: Tensor, name: str) -> BTF:
    """A BTF of planted texels."""
    pairs = direction_pairs(directions, directions)
    return texture([truth(*pairs) for truth in truths], directions, name)


@dataclass(frozen=True)
class Case:
    """A hard input and its bounds.

    Attributes:
        what: for people.
        make: the BTF.
        lobes, model: least SNR in dB of lobes alone, and with their residual.
        truth: of texel 0, at any directions; None if it has none.
        between: least SNR in dB of the lobes of texel 0 between the measured directions.
        settings: of the fit, beside `QUICK`.
    """

    what: str
    make: Callable[[], BTF]
    lobes: float
    model: float
    truth: Planted | None = None
    between: float | None = None
    settings: dict[str, Any] = field(default_factory=dict)

    def fit(self) -> FitResult:
        """Fits the case."""
        return fit(self.make(), FitConfig.from_dict(merged(QUICK, self.settings)))

    def snr_between(self, result: FitResult) -> float | None:
        """SNR in dB of the lobes of texel 0 between the measured directions."""
        return None if self.truth is None else snr_between(result, self.truth)


def snr_between(result: FitResult, truth: Callable[[Tensor, Tensor], Tensor]) -> float:
    """SNR in dB of the lobes of texel 0, against a truth at directions not measured."""
    wi, wo = directions_between()
    uv = torch.tensor([0.5 / result.model.width, 0.5]).expand(len(wi), 2)
    with torch.no_grad():
        found = result.model(uv, wi.float(), wo.float(), residual=False).double()
    wanted = truth(wi, wo)
    return snr_db(float(wanted.square().sum()), float((found - wanted).square().sum()))


def merged(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Nested settings, the second ones winning."""
    result = dict(first)
    for key, value in second.items():
        inner = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if inner else value
    return result


def directions_between() -> tuple[Tensor, Tensor]:
    """Random light and view directions, uniform in solid angle up to `STEEPEST` degrees."""
    generator = torch.Generator().manual_seed(0)
    low = math.cos(math.radians(STEEPEST))
    random = torch.rand(2, 2, BETWEEN, generator=generator, dtype=torch.float64)
    theta = torch.arccos(low + (1.0 - low) * random[0])
    return tuple(direction_from_angles(theta, 2.0 * math.pi * random[1]).unbind(0))


WHITE = (1.0, 1.0, 1.0)
GREY = (0.3, 0.25, 0.2)
DIFFUSE = Lobe("lambertian")
NEEDLE = Planted((DIFFUSE, Lobe("blinn_phong", (5000.0,))), (GREY, (0.01, 0.01, 0.01)))
SHARP = [
    Planted((DIFFUSE, Lobe("blinn_phong", (660.0,), 5.0)), (GREY, (0.02 * i, 0.02, 0.01 * i)))
    for i in range(1, 5)
]
RIM = Planted(
    (DIFFUSE, Lobe("cook_torrance", (0.35, 0.04)), Lobe("ward", (0.3, 0.3), 10.0, 90.0)),
    (GREY, (0.5, 0.5, 0.4), (0.1, 0.1, 0.2)),
)
RETRO = Planted((DIFFUSE, Lobe("lafortune", (1.0, 12.0))), (GREY, (0.5, 0.4, 0.3)))
WARP = Planted((DIFFUSE, Lobe("ward", (0.6, 0.15), 12.0, 0.0, 0.0)), (GREY, (0.2, 0.2, 0.2)))
WEFT = Planted((DIFFUSE, Lobe("ward", (0.6, 0.15), 12.0, 90.0, 90.0)), (GREY, (0.1, 0.2, 0.3)))
TWINS = Planted(
    (Lobe("blinn_phong", (20.0,), 10.0), Lobe("blinn_phong", (20.005,), 10.0)),
    (WHITE, (0.5, 1.0, 2.0)),
)
GLOSS = Planted((DIFFUSE, Lobe("blinn_phong", (40.0,), 5.0)), (GREY, (0.3, 0.3, 0.3)))

DARK = Planted(GLOSS.lobes, ((0.03, 0.025, 0.02), (0.3, 0.3, 0.3)))


def scaled(truth: Planted, factor: float) -> Planted:
    """The same, brighter."""
    return Planted(truth.lobes, tuple(tuple(factor * w for w in row) for row in truth.weights))


def mirror_spot() -> BTF:
    """A grey texel one of whose 6,561 pairs is white and hundreds of times as bright."""
    directions = ring_directions()
    values = Planted((DIFFUSE,), (GREY,))(*direction_pairs(directions, directions))
    values[81 * 40 + 40] = 30.0
    return texture([values], directions, "mirror spot")


def wide_range() -> BTF:
    """Eight texels, each 7 times as bright as the last: from 1 to 10^6."""
    return planted_texture([scaled(GLOSS, 10.0 ** (6 * i / 7)) for i in range(8)], COARSE, "range")


def half_black() -> BTF:
    """Every second texel reflects nothing."""
    black = scaled(GLOSS, 0.0)
    return planted_texture([GLOSS, black, RETRO, black], COARSE, "half black")


def noisy(
    level: float,
    negative: str = "keep",
    dtype: torch.dtype = torch.float32,
    truth: Planted | None = None,
) -> BTF:
    """Nine texels with noise of `level` times the root mean square of the values."""
    generator = torch.Generator().manual_seed(0)
    values = (truth or GLOSS)(*direction_pairs(COARSE, COARSE))
    scale = level * values.square().mean().sqrt()
    texels = [
        values + scale * torch.randn(values.shape, generator=generator, dtype=torch.float64)
        for _ in range(9)
    ]
    return texture(texels, COARSE, f"noise {level:g}", negative, dtype)


def noise_bound(level: float) -> float:
    """SNR in dB of the noise itself, less half a decibel."""
    return -20.0 * math.log10(level) - 0.5


CASES: dict[str, Case] = {
    "narrow": Case(
        "a lobe of 1 degree, sampled every 20 degrees",
        lambda: planted_texture([NEEDLE], COARSE, "narrow"),
        lobes=25.0,
        model=80.0,
    ),
    "sharp": Case(
        "lobes of 3 degrees, sampled every 20 degrees, in texels that share them",
        lambda: planted_texture(SHARP, COARSE, "sharp"),
        lobes=80.0,
        model=80.0,
        truth=SHARP[0],
        between=60.0,
    ),
    "grazing": Case(
        "light and view at 80 and 87 degrees",
        lambda: planted_texture([RIM], GRAZING, "grazing"),
        lobes=80.0,
        model=80.0,
        truth=RIM,
        between=60.0,
    ),
    "retro": Case(
        "light thrown back to where it came from",
        lambda: planted_texture([RETRO], COARSE, "retro"),
        lobes=80.0,
        model=80.0,
        truth=RETRO,
        between=80.0,
    ),
    "threads": Case(
        "two threads with highlights across each other",
        lambda: planted_texture([WARP, WEFT] * 4, COARSE, "threads"),
        lobes=80.0,
        model=80.0,
        truth=WARP,
        between=80.0,
    ),
    "mirror": Case(
        "one bright sample in 6,561",
        mirror_spot,
        lobes=25.0,
        model=80.0,
        settings={"search": {"exchanges": 0, "restarts": 2, "bank_normals": 24}},
    ),
    "range": Case("texels from 1 to 10^6", wide_range, lobes=80.0, model=80.0),
    "black": Case("every second texel black", half_black, lobes=80.0, model=80.0),
    "constant": Case(
        "nine equal texels",
        lambda: planted_texture([GLOSS] * 9, COARSE, "constant"),
        lobes=80.0,
        model=80.0,
        truth=GLOSS,
        between=80.0,
    ),
    "one_texel": Case(
        "one texel",
        lambda: planted_texture([GLOSS], COARSE, "one texel"),
        lobes=80.0,
        model=80.0,
        truth=GLOSS,
        between=80.0,
    ),
    "one_direction": Case(
        "one light, one view",
        lambda: planted_texture([GLOSS, RETRO], COARSE[8:9], "one direction"),
        lobes=80.0,
        model=80.0,
    ),
    "twins": Case(
        "two lobes whose Gram matrix has a condition of 10^8",
        lambda: planted_texture([TWINS] * 2, COARSE, "twins"),
        lobes=80.0,
        model=80.0,
        truth=TWINS,
        between=80.0,
    ),
    **{
        f"noise_{percent}": Case(
            f"noise of {percent} %",
            lambda percent=percent: noisy(percent / 100.0),
            lobes=noise_bound(percent / 100.0),
            model=noise_bound(percent / 100.0),
            truth=GLOSS,
            between=noise_bound(percent / 100.0) + 12.0,
        )
        for percent in (1, 5, 20)
    },
}
