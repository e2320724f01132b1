"""The report of an edited run: its edits, and pictures before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from ..model.spmm import SPMM
from ..render.display import display_codes, white_exposure
from .contract import (
    MSSIM,
    PSNR,
    SNR,
    Ablation,
    Display,
    Report,
    Seconds,
    Sharpness,
    Sizes,
)
from .html import render_template
from .maps import Maps, model_maps
from .pairs import Pair, choose_pairs, directions_text
from .views import Gallery, Picture, PictureRow


def edited_report(report: Report, model: SPMM) -> Report:
    """The content of `report.json` of an edited model.

    Sizes and counts are those of the edited model; errors and times of the fit become null.

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
        sharpness=Sharpness(),
        display=Display(),
        seconds=Seconds(),
        weighted_snr_db=None,
        error_without_model=Ablation(),
        clusters=model.cluster_count,
        total_basis=len(model.lobe_model),
        mean_basis_per_texel=len(model.index) / model.texel_count,
        bytes=sizes,
        bytes_per_texel=model.bytes_per_texel(),
        compression_ratio=report.raw_bytes / sizes.total,
        lobes_by_model=model.lobe_use_by_model(),
    )


@dataclass(frozen=True)
class Counts:
    """Sizes of a model."""

    lobes: int
    lobes_per_texel: float
    clusters: int
    bytes: int

    @classmethod
    def of(cls, model: SPMM) -> Counts:
        """The counts of a model."""
        return cls(
            len(model.dictionary),
            len(model.index) / model.texel_count,
            model.cluster_count,
            model.byte_counts()["total"],
        )


@dataclass(frozen=True)
class EditedPage:
    """The values of `edited.html.j2`.

    Attributes:
        name: of the material.
        script: the edits, as YAML.
        slices: the model before and after the edits, at some direction pairs.
        maps: clusters and lobes of the edited model.
        before, after: sizes of the models.
    """

    name: str
    script: str
    slices: Gallery
    maps: Maps
    before: Counts
    after: Counts


def write_edited_html(path: Path, before: SPMM, after: SPMM, script: str) -> None:
    """Writes the page of an edited run.

    Args:
        path: file to write.
        before, after: the models.
        script: the edits between them, as YAML.
    """
    counts = Counts.of(before), Counts.of(after)
    page = EditedPage(after.name, script, _slices(before, after), model_maps(after), *counts)
    path.write_text(render_template("edited.html.j2", page), encoding="utf-8")


def _slices(before: SPMM, after: SPMM) -> Gallery:
    note = (
        "Both pictures of a row share one exposure, which maps the 99th percentile of the one "
        "before the edit to white, and the sRGB curve. Angles are polar / azimuth."
    )
    pairs = choose_pairs(after.light, after.view)
    return Gallery("Texture slices", note, tuple(_row(before, after, pair) for pair in pairs))


@torch.no_grad()
def _row(before: SPMM, after: SPMM, pair: Pair) -> PictureRow:
    """Both models at one direction pair, with the same exposure."""
    wi, wo = after.light[pair.light], after.view[pair.view]
    linear = [model.picture(wi, wo).clamp(min=0.0) for model in (before, after)]  # [H, W, 3] each
    exposure = white_exposure(linear[0].cpu().numpy())
    pictures = (
        Picture.of_texels(display_codes(part, exposure), f"{pair.title}: {name.lower()}", name)
        for name, part in zip(("Before", "After"), linear, strict=True)
    )
    return PictureRow(pair.title, directions_text(wi, wo), tuple(pictures))
