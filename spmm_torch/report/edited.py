"""Report of an edited run: what was done to it, and how it looks before and after."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from ..model.spmm import SPMM
from ..render.display import auto_exposure, display_codes
from . import wording
from .contract import MSSIM, PSNR, SNR, Report, Seconds, Sizes
from .maps import maps_section
from .markup import Markup, definitions, figure, join, picture, tag
from .pairs import Pair, angles, choose_pairs
from .pictures import png_uri
from .slices import SHOWN_WIDTH
from .style import STYLE

NOTE = (
    "This model was edited after its fit. It is no longer meant to match the measured material, so "
    "no errors are given: those of the fit are in the report of the run that it was made from."
)


def edited_report(report: Report, model: SPMM) -> Report:
    """The figures of an edited model.

    Sizes and counts are those of the edited model. Errors and times are null, as they were those
    of the fit.

    Args:
        report: of the run that was edited.
        model: the edited model.
    """
    sizes = Sizes(**model.byte_counts())
    return replace(
        report,
        psnr_db=PSNR(),
        snr_db=SNR(),
        mssim=MSSIM(),
        seconds=Seconds(),
        clusters=model.cluster_count,
        total_basis=len(model.lobe_model),
        mean_basis_per_texel=len(model.index) / model.texel_count,
        bytes=sizes,
        compression_ratio=report.raw_bytes / sizes.total,
        lobes_by_model=model.lobe_use_by_model(),
    )


def write_edited_html(path: Path, before: SPMM, after: SPMM, script: str) -> None:
    """Writes the page of an edited run.

    Args:
        path: file to write.
        before, after: the models.
        script: the edits that lie between them, as YAML.
    """
    title = f"{after.name} – edited"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Markup(STYLE)),
    )
    body = tag(
        "body",
        tag("h1", title),
        tag("p", NOTE, class_="quiet"),
        tag("h2", "Edits"),
        tag("div", tag("pre", script), class_="panel"),
        _pictures(before, after),
        maps_section(after),
        _counts(before, after),
    )
    page = join((Markup("<!DOCTYPE html>\n"), tag("html", head, body, lang="en"), "\n"))
    path.write_text(page, encoding="utf-8")


def _pictures(before: SPMM, after: SPMM) -> Markup:
    rows = [_row(before, after, pair) for pair in choose_pairs(after.light, after.view)]
    return join((tag("h2", "Texture slices"), *rows))


@torch.no_grad()
def _row(before: SPMM, after: SPMM, pair: Pair) -> Markup:
    """Both models under one pair of directions, with the same exposure."""
    wi, wo = after.light[pair.light], after.view[pair.view]
    pictures = [model.picture(wi, wo).clamp(min=0.0) for model in (before, after)]
    whole = [torch.ones_like(picture[..., 0]) for picture in pictures]
    exposure = auto_exposure(pictures[:1], whole[:1])
    figures = []
    for name, linear in zip(("Before", "After"), pictures, strict=True):
        uri = png_uri(display_codes(linear, exposure))
        alternative = f"{pair.title}: {name.lower()}"
        figures.append(figure(picture(uri, alternative, pixelated=after.width < SHOWN_WIDTH), name))
    where = f" · light {angles(wi)}, view {angles(wo)}"
    heading = tag("h3", pair.title, tag("span", where, class_="quiet"))
    return tag("div", heading, tag("div", *figures, class_="slices"), class_="panel")


def _counts(before: SPMM, after: SPMM) -> Markup:
    rows = [
        (name, f"{wording.count(count(before))} before, {wording.count(count(after))} after")
        for name, count in (
            ("Lobes in the dictionary", lambda model: len(model.lobe_model)),
            ("Lobes a texel", lambda model: len(model.index) / model.texel_count),
            ("Clusters", lambda model: model.cluster_count),
            ("Bytes", lambda model: model.byte_counts()["total"]),
        )
    ]
    return join((tag("h2", "Size"), tag("div", definitions(rows), class_="panel")))
