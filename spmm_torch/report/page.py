"""`report.html`: one self-contained file without scripts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..data import BTF
from ..data.scattered_btf import ScatteredBTF
from ..model.spmm import SPMM
from . import wording
from .charts import Bar, bar_chart
from .contract import check_report
from .html import render_template
from .maps import Maps, model_maps
from .materials import Materials, are_materials, material_section
from .relief import relief_gallery
from .slices import slice_gallery
from .views import Chart, Gallery

Report = Mapping[str, Any]
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True)
class ReportPage:
    """The values of `report.html.j2`.

    Attributes:
        report: the content of `report.json`.
        btf: that was fitted.
        sections: shown first.
        slices: original and model at some direction pairs; None where the input has no pictures.
        maps: clusters and lobes of the model; None for materials.
        materials: texels that are no texture; None for a texture.
    """

    report: Report
    btf: BTF
    sections: Sequence[Gallery]
    slices: Gallery | None = None
    maps: Maps | None = None
    materials: Materials | None = None

    @property
    def measured(self) -> str:
        """Under what the texels were measured."""
        if isinstance(self.btf, ScatteredBTF):
            count = self.btf.value_count // self.btf.channels
            return f"{count:,} scattered samples (no grid, so neither a residual nor a relief)"
        return f"{len(self.btf.light)} lights × {len(self.btf.view)} views"

    @property
    def gain_db(self) -> float | None:
        """SNR of the whole model above that of bare cluster means; None where one is not finite."""
        snr = self.report["snr_db"]
        whole, means = snr["with_residual"], snr["cluster_mean"]
        if whole is None or means is None:
            return None
        return whole - means if math.isfinite(whole - means) else None

    @property
    def hours(self) -> float | None:
        """Time of the fit, in the unit of the paper."""
        total = self.report["seconds"]["total"]
        return None if total is None else total / SECONDS_PER_HOUR

    @property
    def megabytes(self) -> float:
        """Size of the model, in the unit of the paper."""
        return self.report["bytes"]["total"] / wording.MEGABYTE

    @property
    def times(self) -> Chart:
        """Seconds of each stage."""
        seconds, device = self.report["seconds"], self.report["device"]
        bars = [
            Bar(name.capitalize(), value or 0.0, wording.seconds(value))
            for name, value in seconds.items()
            if name != "total"
        ]
        caption = f"{wording.seconds(seconds['total'])} in all on {device}."
        return Chart("Time by stage", bar_chart(bars, "Time by stage"), caption)

    @property
    def sizes(self) -> Chart:
        """Bytes of each part of the model."""
        sizes = self.report["bytes"]
        bars = [
            Bar(name.capitalize(), value, wording.size(value))
            for name, value in sizes.items()
            if name != "total"
        ]
        raw = wording.size(self.report["raw_bytes"])
        caption = f"{wording.size(sizes['total'])} in all; the source has {raw} at its bit depth."
        return Chart("Size by part", bar_chart(bars, "Size by part"), caption)


def write_html(
    path: Path, report: Report, model: SPMM, btf: BTF, sections: Sequence[Gallery] = ()
) -> None:
    """Writes the page of one run.

    Args:
        path: file to write.
        report: the content of `report.json`.
        model: the fitted model; its directions are those of `btf`.
        btf: that it was fitted to.
        sections: shown before the figures.

    Raises:
        ValueError: keys of the report are missing or unknown.
    """
    check_report(report)
    relief = relief_gallery(model, btf)
    has_pictures = not isinstance(btf, ScatteredBTF)
    sections = sections if relief is None else (relief, *sections)
    if are_materials(btf):
        page = ReportPage(report, btf, sections, materials=material_section(model, btf))
    else:
        slices = slice_gallery(model, btf) if has_pictures else None
        page = ReportPage(report, btf, sections, slices, model_maps(model))
    path.write_text(render_template("report.html.j2", page), encoding="utf-8")
