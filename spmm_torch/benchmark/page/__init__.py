"""`benchmark.html`: one self-contained file without scripts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...report.html import render_template
from ...report.views import Chart
from .limits import limit_charts
from .peers import GROUPS, peer_charts
from .rates import lead_lines, rate_charts
from .scaling import STAGES, scaling_charts
from .sweep import sweep_charts

Part = Mapping[str, Any]
CHARTS: dict[str, Callable[[Part], tuple[Chart, ...]]] = {
    "sweep": sweep_charts,
    "peers": peer_charts,
    "rates": rate_charts,
    "scaling": scaling_charts,
    "limits": limit_charts,
}


@dataclass(frozen=True)
class BenchmarkPage:
    """The values of `benchmark.html.j2`.

    Attributes:
        name: of the input.
        results: the content of `benchmark.json`.
        charts: of each part of the results that has charts.
        groups: heading and note of each group of peers.
        stages: of the fit whose scaling is shown.
        leads: where peers are ahead of us, one sentence each.
    """

    name: str
    results: Mapping[str, Any]
    charts: Mapping[str, tuple[Chart, ...]]
    groups: Mapping[str, tuple[str, str]]
    stages: tuple[str, ...]
    leads: tuple[str, ...] = ()


def write_page(path: Path, results: Mapping[str, Any]) -> None:
    """Writes the page of a benchmark.

    Args:
        path: file to write.
        results: the content of `benchmark.json`; missing parts are left out.
    """
    charts = {part: draw(results[part]) for part, draw in CHARTS.items() if part in results}
    name = Path(results["input"]["path"]).stem
    leads = lead_lines(results["rates"]) if "rates" in results else ()
    page = BenchmarkPage(name, results, charts, GROUPS, STAGES, leads)
    path.write_text(render_template("benchmark.html.j2", page), encoding="utf-8")
