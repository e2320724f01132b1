"""`evaluation.html`: one file that holds all it shows and needs no script."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ..report import wording
from ..report.frame import Card, card_row, document
from ..report.heat_map import Axis, heat_map
from ..report.maps import texel_map
from ..report.markup import Markup, definitions, figure, join, table, tag
from ..report.pairs import Pair
from ..report.pictures import heat_colours
from ..report.slices import slices_section
from .judge import Judgement
from .sphere_section import channel_scores, sphere_section

# Texels are coloured by the decibels of their error below the worst one, down to this.
SHOWN_DECIBELS = 30
# Direction pairs of which pictures are shown.
SHOWN_PAIRS = 3


def evaluation_page(found: Judgement) -> str:
    """The whole page."""
    name = found.source.btf.name
    return document(
        f"{name} – SPMM evaluation",
        (
            _title(found),
            card_row(_cards(found.figures)),
            sphere_section(found.likeness),
            _angles(found),
            _texels(found),
            _pairs(found),
            _details(found),
        ),
    )


def _title(found: Judgement) -> Markup:
    model, figures = found.source.model, found.figures
    text = (
        f"The saved model of {figures['run']} against {figures['input']}: {model.width} × "
        f"{model.height} texels, {figures['direction_pairs']:,} direction pairs, recomputed from "
        f"the file in linear cosine-weighted values."
    )
    return join((tag("h1", found.source.btf.name), tag("p", text, class_="quiet")))


def _cards(figures: dict[str, Any]) -> list[Card]:
    snr, psnr, mssim = figures["snr_db"], figures["psnr_db"], figures["mssim"]
    cards = [
        (
            "SNR with residual",
            wording.decibels(snr["with_residual"]),
            f"cluster means {wording.decibels(snr['cluster_mean'])}",
        ),
        (
            "SNR, lobes alone",
            wording.decibels(snr["without_residual"]),
            f"PSNR {wording.decibels(psnr['without_residual'])}",
        ),
        (
            "PSNR with residual",
            wording.decibels(psnr["with_residual"]),
            f"peak {figures['psnr_peak']:.4g}",
        ),
        ("MSSIM", f"{mssim['mean']:.3f}", channel_scores(mssim)),
    ]
    if figures["flip"] is not None:
        cards.append(("FLIP", f"{figures['flip']:.3f}", "0 where nothing differs"))
    held_out = figures["held_out"]
    if held_out is not None:
        note = f"{wording.plural(held_out['direction_pairs'], 'pair')} that the fit did not see"
        cards.append(("SNR, held out", wording.decibels(held_out["snr_db"]["with_residual"]), note))
    return cards


def _angles(found: Judgement) -> Markup:
    """Heat maps: how well each pair of rings is met, and where the error lies."""
    table, held_out = found.table, found.held_out
    panels = [
        ("SNR in dB", table.snr_db(), "Signal over error of each pair of rings, with residual."),
        ("Share of the squared error in %", 100.0 * table.share(), "All cells make 100 %."),
    ]
    if held_out is not None:
        caption = "The pairs that the fit did not see."
        panels.append(("SNR in dB, held out", held_out.snr_db(), caption))
    views, lights = (
        Axis(f"{name}, polar angle", [f"{angle:g}°" for angle in ring])
        for name, ring in (("view", table.view), ("light", table.light))
    )
    parts = [
        tag(
            "div",
            tag("h3", title),
            figure(heat_map(values.tolist(), _texts(values), views, lights, title), caption),
            class_="panel",
        )
        for title, values, caption in panels
    ]
    return join((tag("h2", "Errors by angle"), tag("div", *parts, class_="panels")))


def _texts(values: Tensor) -> list[list[str]]:
    return [[_number(value) for value in row] for row in values.tolist()]


def _number(value: float) -> str:
    return wording.signed(value, ".1f") if math.isfinite(value) else wording.UNKNOWN


def _texels(found: Judgement) -> Markup:
    error = found.errors.texel_error
    below = 10.0 * torch.log10(error.max() / error)  # infinite where nothing is wrong
    finite = below[below.isfinite()]
    span = min(SHOWN_DECIBELS, max(1, math.ceil(float(finite.max())))) if len(finite) else 1
    step = span - below.nan_to_num(nan=span).clamp(max=span).round().long()
    image = texel_map(
        found.source.model, step, heat_colours(span + 1), "Map of the error of each texel"
    )
    caption = (
        f"Squared error of each texel: the worst is yellow; dark is {span} dB less, or below that."
    )
    rows = [
        (f"{row['x']}, {row['y']}", wording.decibels(row["snr_db"]), _share(row))
        for row in found.figures["worst_texels"]
    ]
    panels = (
        (tag("h3", "Map"), figure(image, caption)),
        (tag("h3", "Worst texels"), table(("x, y", "SNR", "Share of the error"), *rows)),
    )
    parts = (tag("div", *panel, class_="panel") for panel in panels)
    return join((tag("h2", "Errors by texel"), tag("div", *parts, class_="panels")))


def _pairs(found: Judgement) -> Markup:
    """A list of the worst direction pairs, and pictures of some of them."""
    rows, btf = found.figures["worst_pairs"], found.source.btf
    if not rows:
        return Markup("")
    listed = [
        (_angle(row["light"]), _angle(row["view"]), wording.decibels(row["snr_db"]), _share(row))
        for row in rows
    ]
    error = found.errors.with_residual * found.source.fitted
    worst = error.argsort(descending=True, stable=True)[: min(SHOWN_PAIRS, len(rows))].tolist()
    pairs = [
        Pair(f"Worst pair {rank}", pair % len(btf.light), pair // len(btf.light))
        for rank, pair in enumerate(worst, start=1)
    ]
    head = ("Light, polar / azimuth", "View, polar / azimuth", "SNR", "Share of the error")
    panel = tag("div", tag("h3", "Worst direction pairs"), table(head, *listed), class_="panel")
    return join((slices_section(found.source.model, btf, pairs, "Errors by pair"), panel))


def _angle(direction: dict[str, float]) -> str:
    return f"{direction['polar']:g}° / {direction['azimuth']:g}°"


def _share(row: dict[str, Any]) -> str:
    return f"{100.0 * row['error_share']:.2f} %"


def _details(found: Judgement) -> Markup:
    figures = found.figures
    difference = figures["report_difference_db"]
    agreement = (
        wording.UNKNOWN if difference is None else f"all figures within {difference:.2g} dB of it"
    )
    flip = figures["flip"]
    held_out = figures["held_out_note"] or (
        f"{wording.count(figures['held_out']['direction_pairs'])} direction pairs, SNR "
        f"{wording.decibels(figures['held_out']['snr_db']['without_residual'])} for lobes alone"
    )
    versions = ", ".join(f"{name} {version}" for name, version in figures["versions"].items())
    rows = (
        ("Run", figures["run"]),
        ("Input", figures["input"]),
        ("Report of the fit", agreement),
        ("Held out", held_out),
        ("FLIP", "needs pip install 'spmm_torch[eval]'" if flip is None else f"{flip:.4f}"),
        ("Device", figures["device"]),
        ("Versions", versions),
    )
    return join((tag("h2", "Details"), tag("div", definitions(rows), class_="panel")))
