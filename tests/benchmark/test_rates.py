"""Bytes against error: every point is counted, and leads are those that a table of points has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch.benchmark import rates
from spmm_torch.benchmark.fits import TimedFit, on_device, plain_fit
from spmm_torch.benchmark.rates.leads import SIGNS, comparable, leads_of
from spmm_torch.benchmark.rates.ours import _fits, our_rows
from spmm_torch.benchmark.rates.subject import Subject, middle
from spmm_torch.benchmark.scope import Bench
from spmm_torch.benchmark.variants import DEFAULT
from spmm_torch.config.shipped import shipped
from spmm_torch.data import BTF, write_npz
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import random_btf
from tests.planted.reliefs import planted_relief

CPU = torch.device("cpu")
SIDE, RANKS = 16, (0, 3)
Row = dict[str, Any]


@pytest.fixture(scope="module")
def raised(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A benchmark of a BTF whose relief pays."""
    path = tmp_path_factory.mktemp("raised") / "raised.npz"
    views = ring_directions(((0.0, 1), (20.0, 6), (40.0, 8), (55.0, 8)))
    write_npz(path, planted_relief(0.0, 0.08, size=(SIDE, SIDE), views=views).btf)
    scope = replace(bench.scope, ranks=RANKS, latents=(4,), training=(0.05,))
    return replace(bench, source=path, scope=scope)


@pytest.fixture(scope="module")
def part(raised: Bench, default: TimedFit) -> Iterator[Row]:
    """What the part gives, and how many measurements it told of."""
    told: list[None] = []
    bench = replace(raised, advance=lambda: told.append(None))
    found = rates.run(bench, default)
    assert len(told) == rates.count(bench.scope)
    yield found


def rows_of(part: Row, curve: str) -> dict[str, Row]:
    return {row["name"]: row for row in part["rows"] if row["curve"] == curve}


def test_all_methods_are_there(part: Row) -> None:
    curves = list(dict.fromkeys(row["curve"] for row in part["rows"]))
    assert curves == [
        "ours, relief",
        "ours, flat",
        "local PCA",
        "local PCA, our relief",
        "neural depth, 0.05 x time",
    ]
    assert {row["material"] for row in part["rows"]} == {"raised"}
    assert all(row["bytes"] > SIDE**2 * row["bytes_per_texel"] > 0.0 for row in part["rows"])
    assert all(row["seconds"] > 0.0 for row in part["rows"])


def test_bytes_of_local_pca_are_a_byte_a_number(part: Row) -> None:
    flat, raised = (rows_of(part, name) for name in ("local PCA", "local PCA, our relief"))
    assert flat["1 x 3"]["bytes_per_texel"] == 3 + 1
    # A plane has no height for each texel; a relief has one byte.
    assert raised["1 x 3"]["bytes_per_texel"] in (4, 5)
    assert flat["1 x 3"]["snr_db"] > flat["1 x 0"]["snr_db"]


def test_a_relief_pays_for_us_and_for_peers(part: Row) -> None:
    for with_relief, flat, name in (
        ("ours, relief", "ours, flat", "rank 3"),
        ("local PCA, our relief", "local PCA", "1 x 3"),
    ):
        ahead, behind = (rows_of(part, curve)[name]["snr_db"] for curve in (with_relief, flat))
        assert ahead > behind + 1.0


def test_shared_stages_change_no_point(raised: Bench, part: Row) -> None:
    base = on_device(shipped(DEFAULT, raised.scope.overrides), CPU)
    for rank in RANKS:
        config = base.override(["relief.mode=off", f"residual.rank={rank}"])
        report = plain_fit(raised.open(), config).report
        row = rows_of(part, "ours, flat")[f"rank {rank}"]
        assert row["bytes"] == pytest.approx(report["bytes"]["total"], rel=0.02)
        assert row["snr_db"] == pytest.approx(report["snr_db"]["with_residual"], abs=0.1)


def test_seconds_of_shared_stages_are_kept(raised: Bench) -> None:
    fits = _fits(Subject("raised", raised.open().load(), raised), "auto")
    assert [rank for rank, _ in fits] == sorted(RANKS, reverse=True)
    seconds = [result.report["seconds"] for _, result in fits]
    for stage in ("cluster", "search"):
        assert seconds[1][stage] == pytest.approx(seconds[0][stage]) != 0.0


def test_materials_are_measured_beside_the_input(raised: Bench, default: TimedFit) -> None:
    seen: list[str] = []
    scope = replace(raised.scope, materials=(Path("a/moss.zip"), Path("b/tiles.zip")))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rates, "_rows", lambda bench, source: seen.append(source.stem) or [])
        found = rates.run(replace(raised, scope=scope), default)
    assert seen == ["raised", "moss", "tiles"] and found == {"rows": [], "leads": []}
    assert rates.count(scope) == 3 * rates.count(raised.scope)


def test_relief_of_a_flat_material_is_none(bench: Bench) -> None:
    scope = replace(bench.scope, ranks=(0,))
    own = replace(bench, scope=scope)
    rows, relief = our_rows(Subject("flat", own.open().load(), own))
    assert relief is None and [row["curve"] for row in rows] == ["ours, relief", "ours, flat"]
    assert rows[0]["snr_db"] == rows[1]["snr_db"]


def large_btf(height: int, width: int) -> BTF:
    return random_btf(ring_directions(((0.0, 1),)), height, width)


def test_the_middle_of_a_large_texture() -> None:
    assert middle(large_btf(4, 6), 6) is None
    found = middle(large_btf(4, 9), 6)
    assert found is not None and found.crop == (1, 0, 6, 4)


def point(
    curve: str, size: float, snr: float, flip: float | None = None, total: float | None = None
) -> Row:
    return {
        "curve": curve,
        "ours": curve == "ours",
        "bytes_per_texel": size,
        "bytes": 100 * size if total is None else total,
        "snr_db": snr,
        "flip": flip,
    }


def test_leads_of_a_known_table() -> None:
    rows = [
        point("ours", 20.0, 9.0),
        point("ours", 40.0, 12.0, total=9000.0),
        point("peer", 10.0, 8.0),
        point("peer", 30.0, 10.5),
        point("peer", 35.0, 11.0),
        point("peer", 90.0, 13.0),  # 9,000 bytes in all, as our largest
    ]
    spans = [
        (lead["first"], lead["end"], lead["lead"])
        for lead in leads_of(rows)
        if lead["cost"] == "bytes_per_texel" and lead["quality"] == "snr_db"
    ]
    assert spans == [(10.0, 20.0, None), (30.0, 40.0, 2.0), (90.0, None, 1.0)]
    totals = [lead["first"] for lead in leads_of(rows) if lead["cost"] == "bytes"]
    assert totals == [1000.0, 3000.0]


def test_a_large_basis_counts_only_over_all_bytes() -> None:
    rows = [point("ours", 20.0, 9.0, total=100.0), point("peer", 20.0, 12.0, total=126.0)]
    (lead,) = leads_of(rows)
    assert lead["cost"] == "bytes" and lead["lead"] == 3.0
    assert comparable(rows, "bytes") == rows and comparable(rows, "bytes_per_texel") == rows[:1]


def test_less_flip_is_a_lead() -> None:
    rows = [point("ours", 20.0, 9.0, 0.2), point("peer", 20.0, 8.0, 0.15)]
    (lead, _) = leads_of(rows)
    assert (lead["quality"], lead["end"]) == ("flip", None)
    assert lead["lead"] == pytest.approx(0.05)
    assert set(SIGNS) == {"snr_db", "flip"}


def test_no_leads_of_a_peer_that_is_behind() -> None:
    assert leads_of([point("ours", 20.0, 9.0), point("peer", 20.0, 9.0)]) == []
