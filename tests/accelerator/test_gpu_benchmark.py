"""The parts of `python -m tests.benchmarks.gpu`, on the simulated device."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from spmm_torch.benchmark.launches.tally import Tally
from spmm_torch.data import Selection
from tests.benchmarks.on_gpu import fits
from tests.benchmarks.on_gpu.parts import COPY, PARTS, PRODUCT
from tests.benchmarks.on_gpu.rows import Row
from tests.benchmarks.on_gpu.sizes import SMALL
from tests.planted.lobes import random_lobes

FEW = (*SMALL.overrides, "search.models=[lambertian]", "search.max_lobes=1")
TINY = replace(SMALL, selection=Selection(texels=9, directions="0,30"), overrides=FEW, full=4)
EXPECTED = {
    "speed": [COPY, PRODUCT],
    "triples": ["300 triples, lobes", "300 triples, with residual"],
    "rendering": ["sphere, 12 x 12 pixels, 4 rays each"],
    "sampling": ["300 samples", "300 densities"],
    "training": ["training step, 100 triples"],
}


@pytest.mark.parametrize("part", EXPECTED)
def test_parts_use_the_device_and_are_counted(part: str, cuda: Tally) -> None:
    rows: list[Row] = []
    PARTS[part]("cuda", TINY, rows.append)
    assert [row.name for row in rows] == EXPECTED[part]
    for row in rows:
        assert row.seconds and row.bytes and row.peak == 0  # the simulated memory
    assert sum(cuda.launches.values())


def test_a_fit_has_a_row_for_each_stage(cuda: Tally) -> None:
    rows: list[Row] = []
    PARTS["full"]("cuda", TINY, rows.append)
    found = {row.name: row for row in rows}  # as a file of rows replaces them
    assert "dB with residual" in found["4 x 4: total"].note
    assert found["4 x 4: search"].flops and found["4 x 4: select"].bytes
    assert all(row.seconds is not None for row in rows)


def test_devices_agree(cuda: Tally) -> None:
    rows: list[Row] = []
    PARTS["agreement"]("cuda", TINY, rows.append)
    assert rows[-1].note == "errors within 0.000 dB, 100 % of lobes the same"


def test_what_differs_is_told(cuda: Tally, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fits, "DECIBELS", -1.0)
    with pytest.raises(AssertionError, match="errors within"):
        PARTS["agreement"]("cuda", TINY, lambda row: None)


def test_lobes_that_are_the_same() -> None:
    lobes = random_lobes(("ward", "lambertian"), torch.Generator().manual_seed(1))
    assert fits.same_lobe(lobes, lobes).tolist() == [[True, False], [False, True]]
    away = replace(lobes, normal=lobes.normal.roll(1, 0))
    assert not fits.same_lobe(lobes, away).any()
    wider = replace(lobes, kappa=1.2 * lobes.kappa)
    assert fits.same_lobe(lobes, wider).tolist() == [[False, False], [False, True]]
