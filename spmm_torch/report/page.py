"""`report.html`: one file that holds all it shows and needs no script."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..data import BTF
from ..model.spmm import SPMM
from . import wording
from .charts import Bar, bar_chart
from .contract import check_report
from .frame import card_row, document
from .maps import maps_section
from .markup import Markup, definitions, figure, join, table, tag
from .slices import slices_section

Report = Mapping[str, Any]
# The head of Table 2 of the paper, without its columns about other work.
TABLE_HEAD = (
    "BTF",
    "Total basis #",
    "Avg basis # / texel",
    "Our size (MB)",
    "Our C.R.",
    "PSNR (w/o ε)",
    "PSNR (with ε)",
    "Our MSSIM",
    "Compression time (hrs)",
)
TABLE_NOTE = (
    "The columns of Table 2 of Wu, Dorsey and Rushmeier 2011; 1 MB is 2^20 bytes, as there. The "
    "paper does not say how it defines PSNR, so these figures do not compare directly with its "
    "rows: here it is 10 log10(peak² / mean e²) over all texels, direction pairs and channels in "
    "linear cosine-weighted values, with a peak of "
)
SECONDS_PER_HOUR = 3600.0


def write_html(
    path: Path, report: Report, model: SPMM, btf: BTF, sections: Sequence[Markup] = ()
) -> None:
    """Write the page of one run.

    Args:
        path: file to write.
        report: what `write_report` takes.
        model: the fitted model; its directions are those of `btf`.
        btf: what it was fitted to.
        sections: more of the page, made elsewhere.

    Raises:
        ValueError: keys of the report are missing or unknown.
    """
    check_report(report)
    page = document(
        f"{btf.name} – SPMM report",
        (
            _title(report, btf),
            _cards(report),
            slices_section(model, btf),
            *sections,
            maps_section(model),
            _cost(report),
            _table_row(report, btf),
            _details(report),
        ),
    )
    path.write_text(page, encoding="utf-8")


def _title(report: Report, btf: BTF) -> Markup:
    dynamic_range = "high" if btf.is_hdr else "low"
    text = (
        f"Sparse parametric mixture model of {btf.width} × {btf.height} texels under "
        f"{len(btf.light)} lights × {len(btf.view)} views, "
        f"{8 * btf.bytes_per_value} bits a channel, {dynamic_range} dynamic range."
    )
    return join((tag("h1", btf.name), tag("p", text, class_="quiet")))


def _cards(report: Report) -> Markup:
    snr, psnr = report["snr_db"], report["psnr_db"]
    cards = (
        ("SNR with residual", wording.decibels(snr["with_residual"]), _gain(snr)),
        (
            "SNR, lobes alone",
            wording.decibels(snr["without_residual"]),
            f"PSNR {wording.decibels(psnr['without_residual'])}",
        ),
        (
            "SNR, cluster means",
            wording.decibels(snr["cluster_mean"]),
            f"baseline, {wording.plural(report['clusters'], 'cluster')}",
        ),
        (
            "Compression",
            wording.ratio(report["compression_ratio"]),
            f"{wording.size(report['raw_bytes'])} to {wording.size(report['bytes']['total'])}",
        ),
        (
            "Lobes a texel",
            wording.three_figures(report["mean_basis_per_texel"]),
            f"of {wording.count(report['total_basis'])} in dictionaries",
        ),
        ("Time", wording.seconds(report["seconds"]["total"]), f"on {report['device']}"),
    )
    return card_row(cards)


def _gain(snr: Mapping[str, float | None]) -> str:
    """What lobes give beyond the bare means of the clusters."""
    whole, means = snr["with_residual"], snr["cluster_mean"]
    if whole is None or means is None or not math.isfinite(whole - means):
        return "lobes and residual"
    return f"{wording.signed(whole - means, '+.2f')} dB over cluster means"


def _cost(report: Report) -> Markup:
    stages = {key: part for key, part in report["seconds"].items() if key != "total"}
    times = [
        Bar(name.capitalize(), value or 0.0, wording.seconds(value))
        for name, value in stages.items()
    ]
    sizes = [
        Bar(name.capitalize(), report["bytes"][name], wording.size(report["bytes"][name]))
        for name in ("weights", "dictionary", "residual")
    ]
    time_caption = f"{wording.seconds(report['seconds']['total'])} in all on {report['device']}."
    size_caption = (
        f"{wording.size(report['bytes']['total'])} in all; the source has "
        f"{wording.size(report['raw_bytes'])} at its own bit depth."
    )
    panels = (
        (tag("h3", "Time by stage"), figure(bar_chart(times, "Time by stage"), time_caption)),
        (tag("h3", "Size by part"), figure(bar_chart(sizes, "Size by part"), size_caption)),
    )
    grid = (tag("div", *panel, class_="panel") for panel in panels)
    return join((tag("h2", "Time and size"), tag("div", *grid, class_="panels")))


def _table_row(report: Report, btf: BTF) -> Markup:
    psnr, mssim = report["psnr_db"], report["mssim"]["mean"]
    hours = report["seconds"]["total"]
    row = (
        btf.name,
        wording.count(report["total_basis"]),
        wording.three_figures(report["mean_basis_per_texel"]),
        wording.three_figures(report["bytes"]["total"] / wording.MEGABYTE),
        wording.ratio(report["compression_ratio"]),
        wording.decibels(psnr["without_residual"]),
        wording.decibels(psnr["with_residual"]),
        wording.UNKNOWN if mssim is None else f"{mssim:.3f}",
        wording.UNKNOWN if hours is None else f"{hours / SECONDS_PER_HOUR:.4f}",
    )
    note = f"{TABLE_NOTE}{report['psnr_peak']:.4g}."
    content = (table(TABLE_HEAD, row), tag("p", note, class_="quiet"))
    return join((tag("h2", "As in the paper"), tag("div", *content, class_="panel")))


def _weighted(report: Report) -> str:
    """The error that the fit has minimized, where values count by weight."""
    snr = report["weighted_snr_db"]
    return "all values count alike" if snr is None else wording.decibels(snr["with_residual"])


def _worth(worth: Mapping[str, Any]) -> str:
    """What every model buys, by some texels."""
    if not worth["snr_db_without"]:
        return wording.UNKNOWN
    parts = [f"{name} {wording.decibels(x)}" for name, x in worth["snr_db_without"].items()]
    whole = wording.decibels(worth["snr_db"])
    return f"{', '.join(parts)}; with all {whole} ({wording.plural(worth['texels'], 'texel')})"


def _details(report: Report) -> Markup:
    starts = report["failed_starts"]
    versions = ", ".join(f"{name} {version}" for name, version in report["versions"].items())
    rows = (
        ("Input", str(report["input"])),
        ("Texels", wording.count(report["texels"])),
        ("Direction pairs", wording.count(report["direction_pairs"])),
        ("Channels", wording.count(report["channels"])),
        ("Clusters", wording.count(report["clusters"])),
        ("Starts of the search", wording.count(starts["starts"])),
        ("of them failed", wording.count(starts["count"])),
        ("SNR by weight, with residual", _weighted(report)),
        ("SNR of lobes alone, without a model", _worth(report["error_without_model"])),
        ("Peak memory", wording.size(report["peak_memory_bytes"])),
        ("Device", str(report["device"])),
        ("Seed", str(report["seed"])),
        ("Versions", versions),
    )
    return join((tag("h2", "Run"), tag("div", definitions(rows), class_="panel")))
