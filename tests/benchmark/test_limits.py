"""What stages must do, and how that becomes a limit."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from spmm_torch.benchmark import limits
from spmm_torch.benchmark.counting import Work
from spmm_torch.benchmark.fits import TimedFit
from spmm_torch.benchmark.limits import STAGES, least_work, seconds_of
from spmm_torch.benchmark.protocol import Protocol
from spmm_torch.benchmark.scope import Bench
from spmm_torch.data import sample_path
from spmm_torch.data.codecs import pillow

MACHINE = {"flops_per_second": 100.0, "bytes_per_second": 10.0}


def test_the_limit_is_the_larger_of_both_times() -> None:
    assert seconds_of(Work(200.0, 10.0), MACHINE) == 2.0
    assert seconds_of(Work(200.0, 70.0), MACHINE) == 7.0


def test_the_product_of_the_selection(bench: Bench, default: TimedFit) -> None:
    btf = bench.open()
    needed = least_work(btf, default.result, Work(5.0, 7.0))
    lobes = default.result.report["total_basis"]
    assert needed["select"].flops == 2 * lobes * 36 * 225 * 3
    assert needed["search"].flops == 5.0
    assert set(needed) == set(STAGES)


def test_operations_do_no_less_than_they_must(bench: Bench, default: TimedFit) -> None:
    result = limits.run(bench, default)
    assert [row["stage"] for row in result["rows"]] == list(STAGES)
    rows = {row["stage"]: row for row in result["rows"]}
    for stage in ("cluster", "search", "select", "dictionary"):
        assert rows[stage]["counted_flops"] >= rows[stage]["flops"] > 0.0
        assert rows[stage]["counted_bytes"] > 0.0
    total = sum(row["seconds"] for row in result["rows"])
    assert total == pytest.approx(default.stages["total"], rel=0.5)
    assert result["bare_decoding"] is None  # no pictures


@pytest.mark.gpu
def test_the_speed_of_a_gpu(bench: Bench) -> None:
    speed = limits.machine_speed(replace(bench, device=torch.device("cuda")))
    assert speed["flops_per_second"] > 0.0
    assert speed["bytes_per_second"] > 0.0


def test_bare_decoding_reads_every_picture(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[int] = []
    decode = pillow.decode
    monkeypatch.setattr(pillow, "decode", lambda data: decoded.append(1) or decode(data))
    scope = replace(bench.scope, protocol=Protocol(1, 0.0))
    timing = limits.bare_decoding(replace(bench, source=sample_path(), scope=scope))
    assert timing is not None and timing.median > 0.0
    # Warm-up and one run; before them, the first picture at each of two openings.
    assert len(decoded) == 2 * 81 * 81 + 2
