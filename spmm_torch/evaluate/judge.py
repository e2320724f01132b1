"""All figures of `evaluation.json`: a model compared with its input."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from ..data import BTF
from ..data.scattered_btf import ScatteredBTF
from ..metrics import Totals, psnr_db, snr_db
from ..model.spmm import SPMM
from ..report.contract import MSSIM, Display, Sharpness
from ..report.summary import device_name, versions
from ..runtime.progress import Progress
from .angles import AngleTable, by_angle
from .flip import flip
from .mssim import Score, mean_score, mssim
from .planes import compare_planes
from .renderings import Renderings
from .sample_errors import sample_errors
from .slices import SliceFigures, slice_figures
from .source import Source
from .spheres import compare_spheres
from .sums import SquaredErrors, squared_errors
from .worst import worst_pairs, worst_texels

# Difference of relative errors (root mean square) that float32 makes: sums have another order, and
# narrow lobes magnify the rounding of directions.
ROUNDING = 2e-6
ALL_FITTED = (
    "The run was fitted to every direction of its input; fit it with --directions to hold some out."
)
ALL_SAMPLES = "Scattered samples: give others with --against to judge a run by what it did not see."


@dataclass(frozen=True)
class Likeness:
    """Similarity of the sphere pictures of a model and its BTF.

    Attributes:
        spheres: the pictures.
        scores: MSSIM of each pair.
    """

    spheres: Renderings
    scores: list[Score]

    @property
    def mssim(self) -> Score:
        """`y`, `cr`, `cb` and `mean` over all pairs."""
        return mean_score(self.scores)


@dataclass(frozen=True)
class Looks:
    """What pictures tell of a fit.

    Attributes:
        likeness: of the sphere pictures.
        planes: pictures of a plane.
        slices: sharpness, and what is seen of slices.
    """

    likeness: Likeness
    planes: Renderings
    slices: SliceFigures


@dataclass(frozen=True)
class Judgement:
    """The results of an evaluation.

    Attributes:
        source: the run and its input.
        texel_error: squared error of each texel, `[T]`.
        pair_error: of each pair of a grid that was fitted, `[D]`; None for scattered samples.
        table: errors of the fitted pairs by polar angles.
        held_out: the same of the pairs that were not fitted; None if all were.
        likeness: of the sphere pictures; None for scattered samples, which have no pictures.
        slices: sharpness, and what is seen of slices, at directions that were fitted.
        figures: the content of `evaluation.json`.
    """

    source: Source
    texel_error: Tensor
    pair_error: Tensor | None
    table: AngleTable
    held_out: AngleTable | None
    likeness: Likeness | None
    slices: SliceFigures
    figures: dict[str, Any]


def likeness(
    model: SPMM, btf: BTF, device: torch.device | str, room: int | None = None
) -> Likeness:
    """Renders the spheres of `spheres`, in `room` bytes if given, and scores them."""
    spheres = compare_spheres(model, btf, device, room)
    return Likeness(spheres, mssim(spheres))


def looks(model: SPMM, btf: BTF, device: torch.device | str, room: int | None = None) -> Looks:
    """Renders spheres and planes, scores the spheres, and compares slices.

    Args:
        model: of the BTF.
        btf: decoded or not.
        device: of the renderings.
        room: bytes that renderings may take, which change no value; None: as many as pay.
    """
    found = likeness(model, btf, device, room)
    planes = compare_planes(model, btf, device, room)
    return Looks(found, planes, slice_figures(model, btf))


def judge(source: Source, device: torch.device, progress: Progress) -> Judgement:
    """Compares a saved model with its input.

    Raises:
        DataError: the input cannot be decoded or is not valid.
    """
    if isinstance(source.btf, ScatteredBTF):
        return _judge_samples(source, source.btf, device, progress)
    model, btf, fitted = source.model, source.btf, source.fitted
    with progress.stage("evaluate", btf.texel_count, "texels") as stage:
        errors = squared_errors(model, btf, fitted, stage)
    with progress.stage("render", 1, "scene"):
        found = likeness(model, btf, device)
        slices = slice_figures(model, source.fitted_part())
    peak = source.fitted_part().peak()
    table = _table(btf, errors, fitted)
    rest = source.held_out
    held_out = _table(btf, errors, rest) if bool(rest.any()) else None
    totals = errors.totals(fitted)
    count = btf.texel_count * int(fitted.sum()) * btf.channels
    figures = {
        "run": str(source.run),
        "input": btf.path,
        "texels": btf.texel_count,
        "direction_pairs": int(fitted.sum()),
        "channels": btf.channels,
        "psnr_peak": peak,
        **decibels(totals, peak, count),
    }
    figures["snr_db"]["cluster_mean"] = snr_db(totals.energy, totals.cluster_mean)
    figures |= {
        "report_difference_db": report_difference(figures, source.report),
        "mssim": found.mssim,
        "mssim_by_light": dict(zip(found.spheres.titles, found.scores, strict=True)),
        "flip": _mean(flip(found.spheres)),
        "sharpness": asdict(slices.sharpness),
        "display": asdict(slices.display),
        "by_angle": _angle_figures(table),
        "worst_texels": worst_texels(errors.texel_energy, errors.texel_error, btf.width),
        "worst_pairs": worst_pairs(errors, btf, fitted),
        "held_out": None if held_out is None else _held_out(source, errors, peak, held_out),
        "held_out_note": ALL_FITTED if held_out is None else None,
        "device": device_name(device),
        "versions": versions(),
    }
    shown = errors.with_residual * fitted
    return Judgement(source, errors.texel_error, shown, table, held_out, found, slices, figures)


def _judge_samples(
    source: Source, btf: ScatteredBTF, device: torch.device, progress: Progress
) -> Judgement:
    """Compares a saved model with scattered samples, of which there are no pictures."""
    with progress.stage("evaluate", btf.texel_count, "texels") as stage:
        errors = sample_errors(source.model, btf, stage)
    totals, peak, slices = errors.totals(), btf.peak(), SliceFigures(Sharpness(), Display())
    figures = {
        "run": str(source.run),
        "input": btf.path,
        "texels": btf.texel_count,
        "direction_pairs": btf.measured_count,
        "channels": btf.channels,
        "psnr_peak": peak,
        **decibels(totals, peak, btf.value_count),
    }
    figures["snr_db"]["cluster_mean"] = None
    same = source.report.get("raw_bytes") == btf.raw_bytes  # else they judge what no fit saw
    figures |= {
        "report_difference_db": report_difference(figures, source.report) if same else None,
        "mssim": asdict(MSSIM()),
        "mssim_by_light": {},
        "flip": None,
        "sharpness": asdict(slices.sharpness),
        "display": asdict(slices.display),
        "by_angle": _angle_figures(errors.table),
        "worst_texels": worst_texels(errors.texel_energy, errors.texel_error, btf.width),
        "worst_pairs": errors.worst,
        "held_out": None,
        "held_out_note": ALL_SAMPLES,
        "device": device_name(device),
        "versions": versions(),
    }
    table = errors.table
    return Judgement(source, errors.texel_error, None, table, None, None, slices, figures)


def decibels(totals: Totals, peak: float, count: int) -> dict[str, dict[str, float]]:
    """`psnr_db` and `snr_db`, each without and with residual, as the report defines them."""
    errors = {
        "without_residual": totals.without_residual,
        "with_residual": totals.with_residual,
    }
    return {
        "psnr_db": {name: psnr_db(peak, error, count) for name, error in errors.items()},
        "snr_db": {name: snr_db(totals.energy, error) for name, error in errors.items()},
    }


def report_difference(figures: dict[str, Any], report: dict[str, Any]) -> float | None:
    """The largest difference in decibels from the figures that the fit reported.

    Infinite figures are null in the report and are left out; None if all are. Errors so small that
    float32 values tell them no better do not differ.
    """
    reported = {group: report.get(group) or {} for group in ("psnr_db", "snr_db")}
    differences = [
        _beyond_rounding(value, reported[group][name])
        for group in reported
        for name, value in figures[group].items()
        if reported[group].get(name) is not None
    ]
    return max(differences, default=None)


def _beyond_rounding(found: float, reported: float) -> float:
    """Difference in decibels of two ratios; 0 where rounding of the values makes it."""
    first, second = (10.0 ** (-0.05 * ratio) for ratio in (found, reported))
    return 0.0 if abs(first - second) < ROUNDING else abs(found - reported)


def _table(btf: BTF, errors: SquaredErrors, pairs: Tensor) -> AngleTable:
    """Errors of some pairs, `[D]` bool, by polar angles."""
    energy, error = errors.energy * pairs, errors.with_residual * pairs
    return by_angle(btf.view, btf.light, energy, error)


def _held_out(
    source: Source, errors: SquaredErrors, peak: float, table: AngleTable
) -> dict[str, Any]:
    """Errors at the pairs that were not fitted."""
    pairs = source.held_out
    number = int(pairs.sum())
    count = source.btf.texel_count * number * source.btf.channels
    return {
        "direction_pairs": number,
        **decibels(errors.totals(pairs), peak, count),
        "by_angle": _angle_figures(table),
    }


def _angle_figures(table: AngleTable) -> dict[str, Any]:
    """Rows are views, columns are lights."""
    return {
        "view_polar_degrees": list(table.view),
        "light_polar_degrees": list(table.light),
        "energy": table.energy.tolist(),
        "squared_error": table.error.tolist(),
        "snr_db": table.snr_db().tolist(),
    }


def _mean(values: list[float] | None) -> float | None:
    return None if values is None else sum(values) / len(values)
