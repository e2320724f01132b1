"""`benchmark.html` of canned results: escaped, self-contained, and every part of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from spmm_torch.benchmark.page import write_page
from spmm_torch.benchmark.page.rates import rate_charts
from spmm_torch.benchmark.peers.problem import SEARCH, SELECTION, WHOLE
from tests.report.test_page import Page

Results = dict[str, Any]
NAME = "<script>wool"
TIME = {"median": 2.0, "fastest": 1.5, "slowest": 2.5, "runs": 3}
STAGES = ("cluster", "search", "select", "refit", "residual", "total")
FIT = {
    "seconds": TIME,
    "snr_db": {"without_residual": 6.9, "with_residual": None, "cluster_mean": 7.8},
    "mean_basis_per_texel": 4.2,
    "total_basis": 14,
    "bytes": {"total": 32_132},
    "peak_memory_bytes": None,
}


def setting(name: str, group: str, **on_front: bool) -> Results:
    return {**FIT, "name": name, "group": group, "on_front": on_front}


def peer(name: str, group: str, snr_db: float | None, note: str = "") -> Results:
    row = {"peer": "spmm" if "spmm" in name else "pca", "name": name, "group": group, "note": note}
    return {
        **row,
        "texels": 4,
        "seconds": {**TIME, "runs": 1},
        "snr_db": snr_db,
        "bytes": 1024 if group == WHOLE else None,
        "mean_basis_per_texel": None,
    }


def rate(curve: str, size: float, snr_db: float | None, flip: float | None = 0.2) -> Results:
    facts = {"material": "wool", "curve": curve, "name": "rank <4>", "ours": "ours" in curve}
    sizes = {"bytes_per_texel": size, "bytes": 4096 * size, "seconds": 2.0}
    return {**facts, **sizes, "snr_db": snr_db, "flip": flip}


def lead(cost: str, quality: str, end: float | None, amount: float | None) -> Results:
    facts = {"material": "wool", "curve": "local PCA", "cost": cost, "quality": quality}
    return {**facts, "first": 2048.0, "end": end, "lead": amount}


@pytest.fixture
def results() -> Results:
    """What a benchmark of all parts finds."""
    growth = {"varies": "texels", "device": "cpu", "threads": 2}
    sizes = {"texels": 64, "direction_pairs": 1089}
    limit = {"stage": "load", "seconds": 0.05, "flops": 2e9, "bytes": 2048, "limit_seconds": 0.01}
    return {
        "environment": {
            "cpu": "a <b>CPU</b>",
            "cores": 2,
            "threads": 2,
            "device": "cpu",
            "system": "Linux",
            "versions": {"torch": "2.13.0", "numpy": "2.4.6"},
            "commit": None,
        },
        "input": {"path": f"data/{NAME}.zip", "raw_bytes": 209_088, **sizes},
        "protocol": {"repeats": 3, "patience_seconds": 0.5, "overrides": []},
        "default": FIT,
        "sweep": {
            "rows": [
                setting("fast", "shipped", seconds=True, bytes=False, both=True),
                setting("merge=0.9", "variants", seconds=False, bytes=False, both=False),
            ]
        },
        "peers": {
            "rows": [
                peer("spmm, default", WHOLE, 8.3),
                peer("local PCA", WHOLE, None, "the best of <i>five</i>"),
                peer("spmm search", SEARCH, 6.4),
                peer("scipy nnls", SELECTION, 7.2),
            ],
            "skipped": [{"peer": "neural BTF", "reason": "it needs another package"}],
        },
        "rates": {
            "rows": [
                rate("ours, relief", 20.0, 9.0),
                rate("ours, relief", 40.0, 12.0),
                rate("local PCA", 30.0, 11.0),
                rate("local PCA", 35.0, 10.0),
            ],
            "leads": [
                lead("bytes", "snr_db", None, 2.0),
                lead("bytes_per_texel", "flip", 4096.0, 0.05),
                lead("bytes", "snr_db", 4096.0, None),
                lead("bytes", "flip", 4096.0, None),
            ],
        },
        "weightings": {"rows": [{**FIT, "error": "log", "mssim": {"mean": 0.78}, "flip": None}]},
        "scaling": {
            "rows": [{**growth, **sizes, "seconds": dict.fromkeys(STAGES, 0.02)}],
            "exponents": [{**growth, "power": dict.fromkeys(STAGES, -0.071) | {"total": None}}],
        },
        "limits": {
            "machine": {"flops_per_second": 3.5e11, "bytes_per_second": 2.2e10},
            "rows": [{**limit, "fraction": 0.2, "counted_fraction": None}],
        },
        "launches": {
            "launch_seconds": 5e-6,
            "rows": [
                {
                    "stage": "search",
                    "launches": 21_996,
                    "waits": 280,
                    "bytes_to_device": 4096,
                    "bytes_to_host": 0,
                    "seconds": 0.11,
                }
            ],
            "launches": [{"line": "lobes/batch.py:200", "count": 3630}],
            "waits": [{"line": "solvers/nnls.py:148 nonzero", "count": 112}],
        },
    }


def written(results: Results, folder: Path) -> str:
    write_page(folder / "benchmark.html", results)
    return (folder / "benchmark.html").read_text(encoding="utf-8")


def rows_of(page: Page) -> dict[str, list[str]]:
    """The cells of each row of a table by its first one."""
    cells = [text for text in page.text if text.strip()]
    return {cell: cells[index : index + 9] for index, cell in enumerate(cells)}


def test_the_page_is_escaped_and_self_contained(results: Results, tmp_path: Path) -> None:
    text = written(results, tmp_path)
    page = Page(text)
    assert not {name for name, _ in page.elements} & {"script", "link", "b", "i"}
    assert f"Benchmark: {NAME}" in page.text
    assert "local PCA: the best of <i>five</i>." in page.text
    assert not re.search(r"(src|href)=|url\(|@import", text)


def test_every_part_is_shown(results: Results, tmp_path: Path) -> None:
    text = written(results, tmp_path)
    assert text.count("<svg") == 4 + 2 + 4 + 1 + 2
    rows = rows_of(Page(text))
    assert rows["fast"][1:4] == ["2.0 s ± 25 %", "6.90 dB", "–"]
    assert rows["fast"][8] == "seconds, both"
    assert rows["merge=0.9"][8] == "–"
    assert rows["scipy nnls"][1:6] == ["2.0 s", "0.50 s", "7.20 dB", "–", "–"]
    assert rows["log"][5:7] == ["0.7800", "–"]
    assert rows["texels"][3:9] == ["−0.07"] * 5 + ["–"]
    assert rows["Load"][1:4] == ["50.0 ms", "2.0 Gflop", "2.00 kB"]
    assert rows["Search"][1:6] == ["21,996", "280", "4.00 kB", "0 bytes", "0.11 s"]
    assert rows["solvers/nnls.py:148 nonzero"][1] == "112"
    assert "neural BTF was skipped: it needs another package." in rows
    assert not re.search(r"\b(nan|inf|None)\b", text)


@pytest.mark.parametrize(
    ("part", "heading"),
    [
        ("sweep", "Our own settings"),
        ("peers", "Other methods"),
        ("rates", "Bytes against error"),
        ("weightings", "Weighting of errors"),
        ("scaling", "Scaling"),
        ("limits", "Stages against their limits"),
        ("launches", "What a GPU is asked"),
    ],
)
def test_a_part_that_was_not_measured_is_left_out(
    part: str, heading: str, results: Results, tmp_path: Path
) -> None:
    whole = Page(written(results, tmp_path)).text
    del results[part]
    rest = Page(written(results, tmp_path)).text
    assert heading in whole and heading not in rest
    assert "Run" in rest


def test_leads_of_others_are_told(results: Results, tmp_path: Path) -> None:
    page = Page(written(results, tmp_path))
    assert "wool, SNR: local PCA is ahead by up to 2.00 dB, from 2.00 kB on." in page.text
    flip = "wool, FLIP: local PCA is ahead by up to 0.050, from 2,048 to 4,096 bytes a texel."
    assert flip in page.text
    alone = "wool: local PCA begins at 2.00 kB, ours at 4.00 kB."
    assert page.text.count(alone) == 1
    results["rates"]["leads"] = []
    assert "Nowhere." in Page(written(results, tmp_path)).text


def test_of_others_only_the_front_is_drawn(results: Results) -> None:
    drawings = [str(chart.drawing) for chart in rate_charts(results["rates"])]
    assert all("30.0 bytes a texel" in drawing for drawing in drawings)
    assert not any("35.0 bytes a texel" in drawing for drawing in drawings)
    assert all("20.0 bytes a texel" in drawing for drawing in drawings)  # of ours all


def test_without_flip_there_are_no_plots_of_it(results: Results) -> None:
    for row in results["rates"]["rows"]:
        row["flip"] = None
    assert [chart.title for chart in rate_charts(results["rates"])] == [
        "wool: SNR in dB over bytes a texel",
        "wool: SNR in dB over bytes in all",
    ]
