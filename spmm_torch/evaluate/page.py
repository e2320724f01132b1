"""`evaluation.html`: one self-contained file without scripts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..model.spmm import SPMM
from ..report import wording
from ..report.heat_map import Axis, heat_map
from ..report.html import render_template
from ..report.maps import texel_map
from ..report.pairs import Pair
from ..report.pictures import heat_colours
from ..report.slices import slice_gallery
from ..report.views import Chart, Gallery, Picture
from .angles import AngleTable
from .judge import Judgement
from .sphere_section import sphere_section

# The largest span of the map of errors, in decibels.
MAX_SPAN = 30
# Direction pairs that are shown as pictures.
SHOWN_PAIRS = 3


@dataclass(frozen=True)
class EvaluationPage:
    """The values of `evaluation.html.j2`.

    Attributes:
        name: of the material.
        model: that was evaluated.
        figures: the content of `evaluation.json`.
        spheres: renderings of original and model; None where the original has no pictures.
        angles: errors by polar angles of light and view.
        texels: the map of the error of each texel.
        pairs: original and model at the worst direction pairs; None where no pair has an error.
    """

    name: str
    model: SPMM
    figures: dict[str, Any]
    spheres: Gallery | None
    angles: tuple[Chart, ...]
    texels: Picture
    pairs: Gallery | None


def evaluation_page(found: Judgement) -> str:
    """The text of the page."""
    model = found.source.model
    page = EvaluationPage(
        found.source.btf.name,
        model,
        found.figures,
        None if found.likeness is None else sphere_section(found.likeness),
        _angles(found.table, found.held_out),
        error_map(model, found.texel_error),
        _worst_pairs(found),
    )
    return render_template("evaluation.html.j2", page)


def _angles(fitted: AngleTable, held_out: AngleTable | None) -> tuple[Chart, ...]:
    """SNR and fraction of the error by rings of view and light."""
    charts = [
        _heat_map(
            fitted,
            fitted.snr_db(),
            "SNR in dB",
            "Signal over error of each pair of rings, with residual.",
        ),
        _heat_map(
            fitted,
            100.0 * fitted.error_fraction(),
            "Share of the squared error in %",
            "All cells add up to 100 %.",
        ),
    ]
    if held_out is not None:
        caption = "Direction pairs that the fit did not see."
        charts.append(_heat_map(held_out, held_out.snr_db(), "SNR in dB, held out", caption))
    return tuple(charts)


def _heat_map(table: AngleTable, values: Tensor, title: str, caption: str) -> Chart:
    """The chart of values `[rows, columns]` of the cells of a table."""
    views, lights = (
        Axis(f"{name}, polar angle", [f"{angle:g}°" for angle in rings])
        for name, rings in (("view", table.view), ("light", table.light))
    )
    cells = values.tolist()
    texts = [[wording.fixed(value, 1) for value in row] for row in cells]
    return Chart(title, heat_map(cells, texts, views, lights, title), caption)


def error_map(model: SPMM, error: Tensor) -> Picture:
    """The map of squared errors `[T]`, in decibels below the worst one."""
    below = 10.0 * torch.log10(error.max() / error)  # infinite for error 0
    finite = below[below.isfinite()]
    span = min(MAX_SPAN, max(1, math.ceil(float(finite.max())))) if len(finite) else 1
    step = span - below.nan_to_num(nan=span).clamp(max=span).round().long()
    caption = f"Squared error: the worst texel is yellow; dark texels are {span} dB or more below."
    alternative = "Map of the error of each texel"
    return texel_map(model, step, heat_colours(span + 1), alternative, caption)


def _worst_pairs(found: Judgement) -> Gallery | None:
    count = min(SHOWN_PAIRS, len(found.figures["worst_pairs"]))
    if not count or found.pair_error is None:
        return None
    btf = found.source.btf
    worst = found.pair_error.argsort(descending=True, stable=True)[:count].tolist()
    pairs = [
        Pair(f"Worst pair {rank}", pair % len(btf.light), pair // len(btf.light))
        for rank, pair in enumerate(worst, start=1)
    ]
    return slice_gallery(found.source.model, btf, pairs, "Errors by pair")
