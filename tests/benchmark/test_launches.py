"""Part launches: counts by stage and by line, and nothing left behind."""

from __future__ import annotations

import torch

from spmm_torch.benchmark import launches
from spmm_torch.benchmark.fits import TimedFit
from spmm_torch.benchmark.launches.by_stage import Asked, TallyWatch
from spmm_torch.benchmark.launches.simulation import simulated_cuda
from spmm_torch.benchmark.scope import Bench


def test_the_default_fit_is_counted(bench: Bench, default: TimedFit) -> None:
    found = launches.run(bench, default)
    rows = {row["stage"]: row for row in found["rows"]}
    assert rows.keys() >= {"load", "cluster", "search", "select", "refit", "residual", "total"}
    parts = [row for stage, row in rows.items() if stage != "total"]
    for kind in ("launches", "waits", "bytes_to_device", "bytes_to_host"):
        assert 0 < sum(row[kind] for row in parts) <= rows["total"][kind], kind
    assert sum(row["launches"] for row in parts) > 0.9 * rows["total"]["launches"]
    assert rows["total"]["seconds"] == 5e-6 * rows["total"]["launches"]
    for kind in ("launches", "waits"):
        counts = [row["count"] for row in found[kind]]
        assert counts == sorted(counts, reverse=True) and 0 < sum(counts) <= rows["total"][kind]
        assert all(".py:" in row["line"] for row in found[kind])


def test_a_watch_of_parts_counts_for_the_whole() -> None:
    with simulated_cuda(by_line=True) as tally:
        watch = TallyWatch(torch.device("cuda"), tally=tally)
        part = watch.one_of(2)
        with part("select"):
            torch.ones(3, device="cuda").sum().item()
        watch.take(part)
        with watch("select"):
            torch.ones(3, device="cuda")
    assert watch.asked == {"select": Asked(4, 1)}
    assert sum(tally.lines.values()) == 4
    assert all(line.startswith("benchmark/test_launches.py:") for line in tally.lines)
