"""`spmm benchmark`: options, bad input, and the whole of it in a small form."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch.benchmark import weightings
from spmm_torch.benchmark.limits import STAGES
from spmm_torch.benchmark.peers import PEERS
from spmm_torch.benchmark.peers.problem import SEARCH, SELECTION, WHOLE
from spmm_torch.benchmark.scope import FULL, SMALL
from spmm_torch.benchmark.variants import SHIPPED
from spmm_torch.cli import benchmark
from spmm_torch.cli.benchmark import (
    PARTS,
    chosen_parts,
    chosen_scope,
    chosen_training,
    finite,
    headlines,
)
from spmm_torch.cli.main import main
from spmm_torch.config.fit import DataConfig
from spmm_torch.data import Selection, load_input
from tests.data.test_picture_set import make_files, write_zip

Results = dict[str, Any]


def test_parts_keep_their_order() -> None:
    assert chosen_parts("limits, sweep") == ["sweep", "limits"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--parts", "sweep,speed"], "--parts names 'speed'; expected some of sweep, peers"),
        (["--repeats", "0"], "--repeats is 0; expected 1 or more."),
        (["--training", "1,x"], "--training is '1,x'; expected positive numbers"),
        (["--training=-1"], "--training is '-1'; expected positive numbers"),
        (["--device", "abacus"], "device is 'abacus'; expected auto"),
        (["nowhere.zip"], "nowhere.zip does not exist; expected pictures"),
    ],
)
def test_bad_input_is_one_sentence(
    options: list[str], complaint: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    sentence = refused("benchmark", "-o", tmp_path / "out", *options)
    assert sentence.startswith(complaint) and sentence.endswith(".")
    assert list(tmp_path.iterdir()) == []


def test_the_input_is_read_as_the_options_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By all parts, and whatever else is measured beside it."""
    codes = np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
    files = make_files(codes, name=lambda n, tl, pl, tv, pv: f"L{tl}_{pl}_V{tv}_{pv}.png")
    write_zip(tmp_path / "a.zip", files[:-1])
    opened = []
    monkeypatch.setattr(
        benchmark, "measure", lambda bench, parts: opened.append(bench) or {"default": {}}
    )
    monkeypatch.setattr("spmm_torch.benchmark.page.write_page", lambda path, results: None)
    options = ["--gamma=1", "--cosine=missing", "--missing=mask", "--pattern=L{tl}_{pl}_V{tv}_{pv}"]
    command = ["benchmark", str(tmp_path / "a.zip"), "-o", str(tmp_path / "out"), *options]
    assert main(command) == 0
    (bench,) = opened
    expected = load_input(
        bench.source, DataConfig(1.0, "missing", "refuse", "mask", options[3][10:])
    )
    for btf in (bench.open(), bench.read(bench.source, Selection())):
        assert torch.equal(btf.missing, expected.missing)
        assert torch.equal(btf.texels(), expected.texels())


def test_an_output_that_exists(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert f"{tmp_path} exists" in refused("benchmark", "-o", tmp_path)


def test_training_times_are_set() -> None:
    assert chosen_training("0.5,10") == (0.5, 10.0)
    assert chosen_training("0") == ()


def test_repeats_are_set() -> None:
    assert chosen_scope(False, None) is FULL
    assert chosen_scope(True, 7).protocol.repeats == 7
    assert chosen_scope(True, 7).texels == SMALL.texels


def test_what_is_not_finite_becomes_null() -> None:
    assert finite({"a": [1.5, float("inf")], "b": (float("nan"), 2)}) == {
        "a": [1.5, None],
        "b": [None, 2],
    }


def test_headlines_print_leads_exponents_and_fractions() -> None:
    power = {"varies": "texels", "device": "cpu", "threads": 2, "power": {"total": 0.987}}
    lead = {"material": "wool", "curve": "local PCA", "cost": "bytes_per_texel", "first": 9.0}
    results = {
        "rates": {
            "leads": [
                {**lead, "quality": "snr_db", "lead": 1.25},
                {**lead, "quality": "snr_db", "lead": None},
                {**lead, "quality": "flip", "lead": 0.1},
            ]
        },
        "scaling": {"exponents": [power, {**power, "power": {"total": None}}]},
        "limits": {
            "rows": [{"stage": "select", "fraction": 0.42}, {"stage": "x", "fraction": None}]
        },
        "launches": {
            "rows": [
                {"stage": "search", "launches": 9, "waits": 9, "seconds": 9.0},
                {"stage": "total", "launches": 39_000, "waits": 1390, "seconds": 0.195},
            ]
        },
    }
    assert headlines(results) == [
        "wool: local PCA is ahead by up to 1.25 dB from 9.0 bytes a texel",
        "time grows with texels to the power 0.99 (cpu, 2 threads)",
        "time grows with texels to the power too fast to tell (cpu, 2 threads)",
        "select: 42 % of its limit",
        "a GPU would be asked for 39,000 operations, 0.20 s to launch, and the host would wait "
        "1,390 times",
    ]


@pytest.mark.slow
def test_a_small_benchmark_makes_sense(tmp_path: Path) -> None:
    # One test: run in parallel, several would each make the benchmark anew.
    folder = tmp_path / "out"
    assert main(["benchmark", "-o", str(folder), "--small"]) == 0
    results = json.loads((folder / "benchmark.json").read_text(encoding="utf-8"))
    check_parts(results)
    check_peers(results["peers"])
    check_rates(results["rates"])
    check_weightings(results)
    check_monotone(results)
    check_fronts(results["sweep"]["rows"])
    check_page((folder / "benchmark.html").read_text(encoding="utf-8"), results)


def check_parts(results: Results) -> None:
    """Everything is there, and in order."""
    assert set(PARTS) <= set(results)
    assert {row["name"] for row in results["sweep"]["rows"]} >= set(SHIPPED)
    assert [row["stage"] for row in results["limits"]["rows"]] == list(STAGES)
    stages = {row["stage"]: row["launches"] for row in results["launches"]["rows"]}
    assert stages["search"] > 0
    assert 0 <= stages["total"] - sum(n for name, n in stages.items() if name != "total") < 100
    for row in results["sweep"]["rows"]:
        assert row["seconds"]["fastest"] <= row["seconds"]["median"] <= row["seconds"]["slowest"]
        assert row["bytes"]["total"] > 0
        assert row["snr_db"]["with_residual"] >= row["snr_db"]["without_residual"]


def check_peers(part: Results) -> None:
    """No peer is missing."""
    assert part["skipped"] == []
    assert {row["peer"] for row in part["rows"]} == {peer.name for peer in PEERS}
    assert {row["group"] for row in part["rows"]} == {WHOLE, SEARCH, SELECTION}
    assert all(row["seconds"]["median"] > 0.0 for row in part["rows"])


def check_rates(part: Results) -> None:
    """Every method has points, and the costs of ours grow with the rank."""
    for curve in ("ours, relief", "ours, flat", "local PCA"):
        rows = [row for row in part["rows"] if row["curve"] == curve]
        assert len(rows) >= len(SMALL.ranks)
        assert all(row["flip"] is not None for row in rows)
    for lead in part["leads"]:
        assert lead["end"] is None or lead["end"] > lead["first"]


def check_weightings(results: Results) -> None:
    """Each weighting is judged by its own pictures."""
    rows = results["weightings"]["rows"]
    assert [row["error"] for row in rows] == list(weightings.KINDS)
    assert rows[0]["snr_db"] == results["default"]["snr_db"]
    assert all(0.0 < row["mssim"]["mean"] <= 1.0 for row in rows)
    assert all(row["flip"] is not None and 0.0 <= row["flip"] <= 1.0 for row in rows)
    assert len({row["mssim"]["mean"] for row in rows}) == len(rows)


def check_monotone(results: Results) -> None:
    """What must be monotone is."""
    given = [row for row in results["peers"]["rows"] if row["group"] == SELECTION]
    snr = {row["name"]: row["snr_db"] for row in given}
    lasso = [snr[name] for name in snr if "Lasso" in name]  # from strong to weak regularization
    assert lasso == sorted(lasso)
    assert max(snr.values()) == snr["scipy.optimize.nnls, texel by texel"]
    rows = {row["name"]: row for row in results["sweep"]["rows"]}
    # What is counted are the lobes in use, so a lobe more or less is chance.
    merged = [rows[f"dictionary.merge={limit}"]["total_basis"] for limit in (0.95, 0.98, 0.995)]
    assert merged[0] <= merged[1] + 1 and merged[1] <= merged[2] + 1
    names = ("storage.weights=byte", "storage.weights=float32")
    sizes = [rows[name]["bytes"]["weights"] for name in names]
    assert sizes[0] < sizes[1]


def check_fronts(rows: list[Results]) -> None:
    """The cheapest and the best are on the front of each cost."""
    costs = {
        "seconds": lambda row: row["seconds"]["median"],
        "bytes": lambda row: row["bytes"]["total"],
    }
    for key, cost in costs.items():
        front = [row for row in rows if row["on_front"][key]]
        best = max(row["mean_snr_db"] for row in rows)
        assert any(row["mean_snr_db"] == best for row in front)
        assert min(map(cost, rows)) == min(map(cost, front))


def check_page(page: str, results: Results) -> None:
    """One file that shows all of it."""
    assert not re.search(r"<script|<link|(src|href)=\"(?!data:)|url\(|@import", page)
    assert page.count("<svg") == 4 + 2 + 4 + len(results["scaling"]["exponents"]) + 2
    assert "prefers-color-scheme: dark" in page
    assert all(row["name"] in page for row in results["peers"]["rows"])
    assert all(f">{name}<" in page for name in SHIPPED)
