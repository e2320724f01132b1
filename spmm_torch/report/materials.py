"""The page of one texel or of unrelated ones: each is a material of its own, not a picture.

A material has a polar plot of slices through its plane of incidence, its albedo over the angle of
view, and its fit beside its samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..data.scattered_btf import ScatteredBTF
from ..geometry.directions import direction_from_angles, hemisphere_spiral
from ..geometry.grazing import grazing_fade, lowest_cosine
from ..geometry.hemisphere import HemisphereInterpolation
from ..metrics import snr_db
from ..model.spmm import SPMM
from .pairs import angles
from .plots import Axis, Point, Series, plot
from .polar import polar_plot
from .views import Chart
from .wording import three_figures

# Materials that are drawn at most: those of the lowest SNR. The table has all of them.
MOST_DRAWN = 48
# Lights of the slices: the measured ones nearest to these polar angles, in degrees, on the left.
SLICE_LIGHTS = (30.0, 60.0)
# Angle from the plane of incidence within which a sample is shown as one of it.
IN_PLANE = math.radians(2.0)
ONE_LIGHT = 1e-3  # angle in radians that rounding makes of a light and itself
SLICE_ANGLES = 179  # of the curves, one a degree
ALBEDO_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)  # of the view, in degrees
ALBEDO_AZIMUTHS, ALBEDO_SAMPLES = 4, 512
QUADRATURE = 1 << 14  # directions of light by which measured albedos are summed
RANKS = 60  # samples that are shown beside the fit
BELOW_SAMPLES = 0.1  # part of the darkest sample that is the lower edge of their chart
MEASURED, LOBES, WHOLE = "measured", "lobes", "lobes + residual"


@dataclass(frozen=True)
class Material:
    """One texel.

    Attributes:
        name: of the material.
        lobes: number of its lobes.
        without_residual, with_residual: SNR in dB over its measured pairs; None if it is black.
    """

    name: str
    lobes: int
    without_residual: float | None
    with_residual: float | None


@dataclass(frozen=True)
class Drawn:
    """Charts of one material."""

    title: str
    charts: tuple[Chart, ...]


@dataclass(frozen=True)
class Materials:
    """The section of the page: figures of all materials, charts of some."""

    rows: Sequence[Material]
    drawn: Sequence[Drawn]

    @property
    def note(self) -> str:
        """What the charts show, and which materials have them."""
        some = f"of the {len(self.drawn)} of lowest SNR" if len(self.drawn) < len(self.rows) else ""
        return (
            f"Charts {some} show the mean of the channels, times the cosine of the light. Polar "
            "plots: the plane of incidence, seen from every angle of view; the dashed line is the "
            "light, radii are cube roots. Albedo: the part of white light from all around that is "
            "reflected towards a view; that of the samples is interpolated between them. Samples: "
            "by brightness, brightest first."
        ).replace("  ", " ")


def are_materials(btf: BTF) -> bool:
    """Whether texels are materials of their own: they have names, or there is only one."""
    return btf.names is not None or btf.texel_count == 1


def materials(model: SPMM, btf: BTF) -> list[Material]:
    """Figures of each texel of a BTF."""
    names, counts = btf.names or (btf.name,), model.lobe_count_per_texel().tolist()
    found = []
    for texel, (name, lobes) in enumerate(zip(names, counts, strict=True)):
        measured, without, whole = _beside(model, btf, texel)
        energy = float(measured.square().sum())
        errors = (float((measured - each).square().sum()) for each in (without, whole))
        snr = [snr_db(energy, error) if energy > 0.0 else None for error in errors]
        found.append(Material(name, lobes, *snr))
    return found


def material_section(model: SPMM, btf: BTF) -> Materials:
    """The section of a BTF of materials; see `are_materials`."""
    rows = materials(model, btf)
    order = sorted(range(len(rows)), key=lambda texel: rows[texel].with_residual or math.inf)
    return Materials(rows, [_drawn(model, btf, t, rows[t]) for t in sorted(order[:MOST_DRAWN])])


@torch.no_grad()
def _beside(model: SPMM, btf: BTF, texel: int) -> tuple[Tensor, Tensor, Tensor]:
    """Samples, lobes and whole model at the measured pairs of a texel, each `[D', C]` float64."""
    wi, wo, samples = btf.samples(texel)
    return (
        samples.double(),
        _values(model, texel, wi, wo, residual=False).double(),
        _values(model, texel, wi, wo, residual=True).double(),
    )


def _values(model: SPMM, texel: int, wi: Tensor, wo: Tensor, *, residual: bool) -> Tensor:
    """Values `[Q, C]` of a texel at directions `[Q, 3]`."""
    place = _centre(model, texel).expand(len(wi), 2)
    return model(place, wi.to(model.light), wo.to(model.light), residual=residual).cpu()


def _centre(model: SPMM, texel: int) -> Tensor:
    """Texture coordinates `[2]` of a texel's centre."""
    row, column = divmod(texel, model.width)
    return model.light.new_tensor([(column + 0.5) / model.width, 1.0 - (row + 0.5) / model.height])


@torch.no_grad()
def _drawn(model: SPMM, btf: BTF, texel: int, row: Material) -> Drawn:
    lights = dict.fromkeys(_nearest_light(btf, polar) for polar in SLICE_LIGHTS)
    slices = [_slice(model, btf, texel, light) for light in lights]
    return Drawn(row.name, (*slices, _albedo(model, btf, texel), _samples(model, btf, texel)))


def _nearest_light(btf: BTF, polar: float) -> int:
    """Index of the measured light nearest to a polar angle in degrees, from the left."""
    wanted = direction_from_angles(torch.tensor(math.radians(polar)), torch.tensor(math.pi))
    return int((btf.light @ wanted).argmax())


def _slice(model: SPMM, btf: BTF, texel: int, light: int) -> Chart:
    """The plane of incidence of one light: samples in it, and the model at every angle."""
    wi, up = btf.light[light], torch.tensor([0.0, 0.0, 1.0])
    flat = torch.stack((wi[0], wi[1], torch.zeros(())))
    away = -flat / flat.norm() if float(flat.norm()) > 0.0 else torch.tensor([1.0, 0.0, 0.0])
    lit, wo, values = btf.samples(texel)
    own = (lit - wi).norm(dim=1) < _near(btf)
    inside = own & ((wo @ torch.linalg.cross(up, away)).abs() < math.sin(IN_PLANE))
    measured, seen = values[inside], wo[inside]
    angle = torch.atan2(seen @ away, seen[:, 2])
    curve = torch.linspace(-89.0, 89.0, SLICE_ANGLES).deg2rad()
    wo = curve.sin()[:, None] * away + curve.cos()[:, None] * up
    series = [_radii(MEASURED, angle, measured, joined=False)]
    for name in (LOBES, WHOLE):
        values = _values(model, texel, wi.expand_as(wo), wo, residual=name == WHOLE)
        series.append(_radii(name, curve, values, joined=True))
    tilt = math.atan2(float(wi @ away), float(wi[2]))
    title = f"Light at {math.degrees(-tilt):.0f}°"
    return Chart(title, polar_plot(series, title, tilt), f"light {angles(wi)}")


def _near(btf: BTF) -> float:
    """Angle from the light of a slice within which a sample is shown as one of it, in radians."""
    return IN_PLANE if isinstance(btf, ScatteredBTF) else ONE_LIGHT


def _radii(name: str, angle: Tensor, values: Tensor, *, joined: bool) -> Series:
    """Cube roots of the mean of the channels `[N, C]` over angles `[N]`."""
    mean = values.mean(-1).clamp(min=0.0)
    points = [
        Point(at, value ** (1.0 / 3.0), f"{math.degrees(at):.0f}°, {value:.4g}")
        for at, value in zip(angle.tolist(), mean.tolist(), strict=True)
    ]
    return Series(name, points, joined)


def _albedo(model: SPMM, btf: BTF, texel: int) -> Chart:
    angles, series = torch.tensor(ALBEDO_ANGLES), []
    if not isinstance(btf, ScatteredBTF):
        series.append(_over_angle(MEASURED, *_measured_albedo(btf, texel), joined=False))
    for name in (LOBES, WHOLE):
        found = _model_albedo(model, texel, angles, residual=name == WHOLE)
        series.append(_over_angle(name, angles, found, joined=True))
    axes = Axis("polar angle of the view, degrees"), Axis("albedo")
    return Chart("Albedo", plot(series, *axes, "Albedo over the angle of view"))


def _over_angle(name: str, polar: Tensor, albedo: Tensor, *, joined: bool) -> Series:
    points = [
        Point(at, value, f"{at:.0f}°, {three_figures(value)}")
        for at, value in zip(polar.tolist(), albedo.tolist(), strict=True)
    ]
    return Series(name, points, joined)


def _measured_albedo(btf: BTF, texel: int) -> tuple[Tensor, Tensor]:
    """Polar angles of the views in degrees and albedo of the samples, interpolated, both `[N]`.

    Views of one polar angle are averaged; those that lack a light are left out.
    """
    wi = hemisphere_spiral(QUADRATURE, math.pi / 2.0)
    index, weight = HemisphereInterpolation.build(btf.light).weights(wi)
    weight = weight * grazing_fade(wi[:, 2:], lowest_cosine(btf.light)) * (2 * math.pi / QUADRATURE)
    solid = weight.new_zeros(len(btf.light)).index_add(0, index.flatten(), weight.flatten())
    values = btf.texels(torch.tensor([texel]))[0].mean(-1).view(len(btf.view), -1)  # [V, L]
    whole = torch.ones(len(btf.view), dtype=torch.bool)
    if btf.missing is not None:
        whole = ~btf.missing.any(1)
    polar = torch.rad2deg(torch.arccos(btf.view[whole, 2].clamp(-1.0, 1.0)))
    rings, ring = polar.round(decimals=1).unique(return_inverse=True)
    total = rings.new_zeros(len(rings)).index_add(0, ring, values[whole] @ solid)
    return rings, total / torch.bincount(ring, minlength=len(rings)).clamp(min=1)


def _model_albedo(model: SPMM, texel: int, polar: Tensor, *, residual: bool) -> Tensor:
    """Albedo `[N]` of a texel for views at polar angles in degrees `[N]`, by importance sampling.

    Azimuths are averaged, and so are channels.
    """
    azimuth = torch.arange(ALBEDO_AZIMUTHS) * (2.0 * math.pi / ALBEDO_AZIMUTHS)
    theta, phi = torch.broadcast_tensors(polar.deg2rad()[:, None], azimuth)
    wo = direction_from_angles(theta, phi).to(model.light)  # [N, A, 3]
    wo = wo[..., None, :].expand(*wo.shape[:2], ALBEDO_SAMPLES, 3)
    u = torch.quasirandom.SobolEngine(3).draw(ALBEDO_SAMPLES).to(model.light)
    place = _centre(model, texel)
    wi, rgb, pdf = model.sample(place, wo, u)
    value = rgb if residual else model(place, wi, wo, residual=False)
    share = value.mean(-1) / pdf.clamp(min=torch.finfo(pdf.dtype).tiny)
    return share.mean((1, 2)).cpu()


def _samples(model: SPMM, btf: BTF, texel: int) -> Chart:
    """Samples from the brightest to the darkest, and the fit at the same directions.

    What is far below the darkest sample is drawn on the lower edge, so that it leaves room.
    """
    parts = [each.mean(-1) for each in _beside(model, btf, texel)]
    order = parts[0].argsort(descending=True)
    bright = parts[0][parts[0] > 0.0]
    floor = BELOW_SAMPLES * float(bright.min()) if len(bright) else 0.0
    ranks = torch.logspace(0.0, math.log10(len(order)), RANKS).round().long().unique()
    series = []
    for name, values in zip((MEASURED, LOBES, WHOLE), parts, strict=True):
        shown = values[order[ranks - 1]].tolist()
        points = [
            Point(rank, max(value, floor), f"sample {rank}, {value:.4g}")
            for rank, value in zip(ranks.tolist(), shown, strict=True)
        ]
        series.append(Series(name, points, joined=name == MEASURED))
    axes = Axis("rank of the sample by brightness", log=True), Axis("value, 1/sr", log=True)
    return Chart("Fit beside the samples", plot(series, *axes, "Fit beside the samples"))
