"""`benchmark.html`: one file that holds all it shows and needs no script."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...report import wording
from ...report.frame import card_row, document
from ...report.markup import Markup, definitions, join, tag
from ...report.plots import PLOT_STYLE
from ...report.style import STYLE
from .limits import limits_section
from .peers import peers_section
from .scaling import scaling_section
from .sweep import sweep_section
from .weightings import weightings_section

SECTIONS = {
    "sweep": sweep_section,
    "peers": peers_section,
    "weightings": weightings_section,
    "scaling": scaling_section,
    "limits": limits_section,
}
INTRODUCTION = (
    "Everything was measured in one run on one machine, on the same data. Times are medians over "
    "the runs that are stated, after a fit that did not count. SNR is 10 log10(Σ y² / Σ e²) over "
    "all values, linear and weighted by the cosine of the light. What loses is shown as it is."
)


def write_page(path: Path, results: Mapping[str, Any]) -> None:
    """Writes the page of a benchmark.

    Args:
        path: file to write.
        results: what `benchmark.json` holds; parts that were not measured are left out.
    """
    name = Path(results["input"]["path"]).stem
    measured = [section(results[part]) for part, section in SECTIONS.items() if part in results]
    sections = (_title(name, results), _cards(results), *measured, _details(results))
    page = document(f"{name} – SPMM benchmark", sections, STYLE + PLOT_STYLE)
    path.write_text(page, encoding="utf-8")


def _title(name: str, results: Mapping[str, Any]) -> Markup:
    given = results["input"]
    text = (
        f"{wording.plural(given['texels'], 'texel')}, "
        f"{wording.count(given['direction_pairs'])} direction pairs, "
        f"{wording.size(given['raw_bytes'])}; {results['environment']['cpu']}, "
        f"{results['environment']['device']}."
    )
    return join(
        (
            tag("h1", f"Benchmark: {name}"),
            tag("p", text, class_="quiet"),
            tag("p", INTRODUCTION),
        )
    )


def _cards(results: Mapping[str, Any]) -> Markup:
    row = results["default"]
    seconds, snr = row["seconds"], row["snr_db"]
    spread = f"{wording.seconds(seconds['fastest'])} to {wording.seconds(seconds['slowest'])}"
    cards = (
        ("Default settings", wording.seconds(seconds["median"]), _runs(seconds["runs"], spread)),
        ("SNR with residual", wording.decibels(snr["with_residual"]), "of default settings"),
        ("SNR, lobes alone", wording.decibels(snr["without_residual"]), "of default settings"),
        ("SNR, cluster means", wording.decibels(snr["cluster_mean"]), "what any fit must beat"),
        (
            "Size",
            wording.size(row["bytes"]["total"]),
            f"{wording.three_figures(row['mean_basis_per_texel'])} lobes a texel",
        ),
    )
    return card_row(cards)


def _runs(count: int, spread: str) -> str:
    return "1 run" if count == 1 else f"median of {count} runs, {spread}"


def _details(results: Mapping[str, Any]) -> Markup:
    place, protocol = results["environment"], results["protocol"]
    versions = ", ".join(f"{name} {version}" for name, version in place["versions"].items())
    rows = (
        ("Processor", f"{place['cpu']}, {place['cores']} cores, {place['threads']} threads"),
        ("Device", place["device"]),
        ("System", place["system"]),
        ("Versions", versions),
        ("Commit", place["commit"] or wording.UNKNOWN),
        ("Input", results["input"]["path"]),
        (
            "Repeats",
            f"{protocol['repeats']} at most, none after {protocol['patience_seconds']:g} s",
        ),
        ("Settings changed for all", ", ".join(protocol["overrides"]) or "none"),
    )
    return join((tag("h2", "Run"), tag("div", definitions(rows), class_="panel")))
