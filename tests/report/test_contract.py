"""report.json: exactly the keys of the contract, and always JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from spmm_torch.report import REPORT_KEYS, Report, check_report, write_report
from spmm_torch.report.contract import older_report


def test_a_full_report_passes(report: dict[str, Any]) -> None:
    check_report(report)


def test_values_below_values_come_back(report: dict[str, Any]) -> None:
    found = Report.from_dict(report)
    assert found.to_dict() == report
    assert found.display.psnr_db.with_residual == report["display"]["psnr_db"]["with_residual"]


def test_every_missing_and_unknown_key_is_named(report: dict[str, Any]) -> None:
    del report["seed"], report["snr_db"]["cluster_mean"]
    report["speed"] = 1.0
    report["bytes"]["index"] = 1
    with pytest.raises(ValueError, match="report keys") as caught:
        check_report(report)
    text = str(caught.value)
    assert "missing: seed, snr_db.cluster_mean" in text
    assert "unknown: bytes.index, speed" in text


def test_a_group_that_is_null_misses_its_keys(report: dict[str, Any]) -> None:
    report["mssim"] = None
    with pytest.raises(ValueError, match=r"mssim\.cb, mssim\.cr, mssim\.mean, mssim\.y"):
        check_report(report)


def test_a_bad_report_is_not_written(report: dict[str, Any], tmp_path: Path) -> None:
    del report["seed"]
    with pytest.raises(ValueError, match="seed"):
        write_report(tmp_path, Report.from_dict(report))
    assert not list(tmp_path.iterdir())


def test_the_order_is_that_of_the_contract(report: dict[str, Any], tmp_path: Path) -> None:
    backwards = dict(reversed(report.items()))
    backwards["seconds"] = dict(reversed(report["seconds"].items()))
    path = write_report(tmp_path, Report.from_dict(backwards))
    assert path == tmp_path / "report.json"
    read = json.loads(path.read_text(encoding="utf-8"))
    assert read == report
    assert tuple(read) == tuple(REPORT_KEYS)
    assert tuple(read["seconds"]) == REPORT_KEYS["seconds"]
    assert path.read_text(encoding="utf-8").startswith('{\n  "input": ')


def test_numbers_that_are_not_finite_become_null(report: dict[str, Any], tmp_path: Path) -> None:
    report["snr_db"]["with_residual"] = math.inf
    report["psnr_db"]["without_residual"] = math.nan
    report["versions"] = {"list": [1.0, -math.inf]}
    read = json.loads(write_report(tmp_path, Report.from_dict(report)).read_text(encoding="utf-8"))
    assert read["snr_db"]["with_residual"] is None
    assert read["psnr_db"]["without_residual"] is None
    assert read["versions"] == {"list": [1.0, None]}
    assert read["snr_db"]["cluster_mean"] == report["snr_db"]["cluster_mean"]


# What reports of earlier releases lack, or have besides.
OLDER: dict[str, dict[str, Any]] = {
    "no display": {"display": None},
    "other groups": {"mssim": 0.9, "sharpness": [1], "seconds": {"load": 1.0}},
    "more keys": {"speed": 1.0, "bytes": {"index": 1, "total": 7}},
    "no version": {"format": None},
}


@pytest.mark.parametrize("case", OLDER)
def test_reports_of_earlier_releases_are_read(report: dict[str, Any], case: str) -> None:
    values = {key: value for key, value in (report | OLDER[case]).items() if value is not None}
    found = older_report(values).to_dict()
    check_report(found)
    assert found["format"] == 1
    untouched = [key for key in report if key not in {*OLDER[case], "auto"}]
    assert all(found[key] == report[key] for key in untouched)


def test_the_first_reports_are_read(report: dict[str, Any]) -> None:
    first = {key: report[key] for key in ("input", "raw_bytes")}
    found = older_report(first)
    assert (found.raw_bytes, found.display.psnr_db.with_residual) == (report["raw_bytes"], None)


@pytest.mark.parametrize("values", [[], None, 3, {}, {"input": "a"}])
def test_what_is_no_report_is_named(values: Any) -> None:
    with pytest.raises(ValueError, match="it lacks input or raw_bytes"):
        older_report(values)
