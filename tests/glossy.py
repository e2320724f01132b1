"""Seven real measured glossy materials [DJ18] among the test data, and what a fit of one is worth.

References:
    [DJ18] Jonathan Dupuy, Wenzel Jakob, An Adaptive Parameterization for Efficient Material
        Acquisition and Rendering, ACM Transactions on Graphics 37(6), 2018.
    [NDM05] Addy Ngan, Fredo Durand, Wojciech Matusik, Experimental Analysis of BRDF Models,
        Eurographics Symposium on Rendering, 2005.
    [WMLT07] Bruce Walter, Stephen Marschner, Hongsong Li, Kenneth Torrance, Microfacet Models for
        Refraction through Rough Surfaces, Eurographics Symposium on Rendering, 2007.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.brdf import REGISTRY
from spmm_torch.data.scattered_btf import ScatteredBTF
from spmm_torch.geometry.directions import direction_pairs
from spmm_torch.metrics import snr_db
from spmm_torch.model.spmm import SPMM
from tests.locations import data_file
from tests.planted.btfs import texel_btf

MATERIALS = "rgl_brdfs.npz"
GRIDS = (81, 151)
FOUR_LOBES = FitConfig.from_dict({"select": {"max_lobes": 4}})
# Polar angles of the view at which the white-sky reflectance is known, in degrees.
ALBEDO_ANGLES = (0.0, 30.0, 45.0, 60.0, 75.0)
# Azimuths of the view at which that of a model is taken: on the grid and between, in degrees.
ALBEDO_AZIMUTHS = (0.0, 13.0, 40.0)
# Half angle beyond which light belongs to the body of a material, in degrees.
BODY = 25.0
HALF = 2500  # of the random pairs of each kind
# Value `[N, 3]` of a material at wi and wo `[N, 3]`, cosine-weighted.
Value = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Material:
    """A measured material: what it is fit to, and the truth elsewhere.

    Attributes:
        name: in the database.
        samples: measured values on a grid, `[D, 3]`.
        directions: of the grid, `[N, 3]`.
        between, mirror: (wi, wo, value), each `[5000, 3]`.
        albedo: white-sky reflectance at `ALBEDO_ANGLES`, `[5, 3]`.
    """

    name: str
    samples: Tensor
    directions: Tensor
    between: tuple[Tensor, Tensor, Tensor]
    mirror: tuple[Tensor, Tensor, Tensor]
    albedo: Tensor

    def btf(self) -> BTF:
        """The samples as a BTF of one texel; values under zero, colours out of gamut, are kept."""
        return texel_btf(self.samples[None], self.directions, name=self.name, negative="keep")

    def apart(self) -> tuple[BTF, Material]:
        """Half of the random pairs as scattered samples, and the material judged by the others."""
        halves = [[side[:HALF] for side in each] for each in (self.between, self.mirror)]
        wi, wo, values = (torch.cat(sides) for sides in zip(*halves, strict=True))
        btf = ScatteredBTF.from_samples(wi, wo, values[None], name=self.name, negative="keep")
        rest = ((wi[HALF:], wo[HALF:], v[HALF:]) for wi, wo, v in (self.between, self.mirror))
        between, mirror = rest
        return btf, replace(self, between=between, mirror=mirror)

    @property
    def pairs(self) -> tuple[Tensor, Tensor]:
        """wi and wo of the samples."""
        return direction_pairs(self.directions, self.directions)


def material_names() -> list[str]:
    """Names of the seven materials."""
    with np.load(data_file(MATERIALS)) as file:
        return [str(name) for name in file["names"]]


def material(name: str, grid: int) -> Material:
    """One material, measured on a grid of so many directions."""
    with np.load(data_file(MATERIALS)) as file:
        part = {key: torch.from_numpy(file[key]) for key in file.files if key != "names"}
    return Material(
        name,
        part[f"{name}_{grid}"].flatten(0, 1),
        part[f"direction_{grid}"],
        (part["between_light"], part["between_view"], part[f"{name}_between"]),
        (part["mirror_light"], part["mirror_view"], part[f"{name}_mirror"]),
        part[f"{name}_albedo"],
    )


@dataclass(frozen=True)
class Figures:
    """What a fit is worth; SNR in dB, of cube roots but for `on_samples`.

    Attributes:
        on_samples: of the values themselves.
        on_samples_seen: on the samples.
        between: at random pairs of directions.
        mirror: at half vectors within 8 degrees of the normal.
        body: between, at half angles beyond 25 degrees.
        albedo: white-sky reflectance over that of the material at `ALBEDO_ANGLES`, mean of the
            channels, `[5]`; NaN where that is unknown.
    """

    on_samples: float
    on_samples_seen: float
    between: float
    mirror: float
    body: float
    albedo: tuple[float, ...]


def figures(own: Material, value: Value) -> Figures:
    """Judges values of a fit by the truth."""
    wi, wo, truth = own.between
    found = value(wi, wo)
    half = torch.nn.functional.normalize(wi + wo, dim=1)
    body = half[:, 2] < math.cos(math.radians(BODY))
    samples = value(*own.pairs)
    return Figures(
        _snr(own.samples, samples),
        seen_snr(own.samples, samples),
        seen_snr(truth, found),
        seen_snr(own.mirror[2], value(*own.mirror[:2])),
        seen_snr(truth[body], found[body]),
        tuple((_albedos(value) / own.albedo.double().mean(1)).tolist()),
    )


def of_model(model: SPMM, *, residual: bool = True) -> Value:
    """The values of the only texel of a model."""

    def value(wi: Tensor, wo: Tensor) -> Tensor:
        with torch.no_grad():
            return model(torch.full((len(wi), 2), 0.5), wi, wo, residual=residual)

    return value


def seen_snr(truth: Tensor, found: Tensor) -> float:
    """SNR of cube roots in dB; values under zero count as black."""
    return _snr(*(part.double().clamp(min=0.0) ** (1.0 / 3.0) for part in (truth, found)))


def _snr(truth: Tensor, found: Tensor) -> float:
    """SNR in dB."""
    error = (truth.double() - found.double()).square().sum()
    return snr_db(float(truth.double().square().sum()), float(error))


def _albedos(value: Value) -> Tensor:
    """White-sky reflectance of views at `ALBEDO_ANGLES`, mean of azimuths and channels, `[5]`."""
    rows = []
    for theta in ALBEDO_ANGLES:
        polar = math.radians(theta)
        each = []
        for degrees in ALBEDO_AZIMUTHS:
            azimuth = math.radians(degrees)
            planar = math.sin(polar)
            wo = (planar * math.cos(azimuth), planar * math.sin(azimuth), math.cos(polar))
            each.append(albedo(value, torch.tensor(wo)).mean())
        rows.append(torch.stack(each).mean())
    return torch.stack(rows)


def albedo(value: Value, wo: Tensor, rings: int = 320, spokes: int = 96) -> Tensor:
    """White-sky reflectance `[3]` for a view `wo [3]`, by quadrature, float64.

    Rings lie about the mirror direction, the denser the nearer, so that narrow peaks are met.
    """
    edges = torch.cat((torch.zeros(1), torch.logspace(-3.5, math.log10(math.pi), rings))).double()
    angle = 0.5 * (edges[1:] + edges[:-1])
    area = (edges[:-1].cos() - edges[1:].cos()) * (2.0 * math.pi / spokes)  # [R]
    turn = (torch.arange(spokes).double() + 0.5) * (2.0 * math.pi / spokes)
    axis = wo.double() * torch.tensor([-1.0, -1.0, 1.0]).double()
    other = torch.tensor([0.0, 1.0, 0.0]).double()
    first = torch.nn.functional.normalize(torch.linalg.cross(other, axis), dim=0)
    second = torch.linalg.cross(axis, first)
    around = turn.cos()[:, None] * first + turn.sin()[:, None] * second  # [S, 3]
    wi = angle.cos()[:, None, None] * axis + angle.sin()[:, None, None] * around
    weight = area[:, None].expand(-1, spokes).flatten()
    wi = wi.flatten(0, 1)
    lit = wi[:, 2] > 0.0
    wi, weight = wi[lit], weight[lit]
    found = value(wi.float(), wo.float().expand(len(wi), 3)).double()
    return (found * weight[:, None]).sum(0)


def ggx_and_lambert(own: Material, *, seen: bool) -> Value:
    """One GGX [WMLT07] and a Lambertian by least squares on the samples, as in [NDM05].

    Args:
        own: the material.
        seen: whether cube roots are compared, or the values themselves.
    """
    wi, wo = (part.double() for part in own.pairs)
    compress = np.cbrt if seen else np.asarray
    target = compress(own.samples.double().clamp(min=0.0).numpy())

    def error(x: np.ndarray) -> np.ndarray:
        return (compress(_ggx_values(torch.from_numpy(x), wi, wo).numpy()) - target).ravel()

    body = own.samples.double().median(0).values.clamp(min=1e-4)
    best = None
    for alpha in (0.02, 0.06, 0.2, 0.5):
        start = torch.cat((body, torch.full((3,), 0.1).double(), torch.tensor([alpha, 0.2])))
        start = start.double().log()
        found = least_squares(error, start.numpy(), bounds=(_LOW, _HIGH), max_nfev=60)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return lambda wi, wo: _ggx_values(torch.from_numpy(best.x), wi.double(), wo.double())


# Logarithms of diffuse albedo (3), weight of the GGX (3), alpha, reflectance at normal incidence.
_LOW = np.log([1e-7] * 6 + [0.002, 0.01])
_HIGH = np.log([10.0] * 3 + [100.0] * 3 + [1.0, 1.0])


def _ggx_values(x: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """The values of GGX and Lambertian, `[N, 3]`."""
    x = x.exp()
    ggx = next(model for model in REGISTRY if model.name == "ggx")
    kappa = torch.stack((x[6], x[6], x[7]))
    lobe = ggx.eval(kappa, wi, wo)[:, None]
    return (x[:3] / math.pi + x[3:6] * lobe) * wi[:, 2:].clamp(min=0.0)
