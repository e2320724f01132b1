"""The result in a few lines."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from spmm_torch.report import Report
from spmm_torch.report.contract import FLIP, SNR, Display, Sharpness
from spmm_torch.report.summary import headline


def test_sharpness_and_display_have_a_line_each(report: dict[str, Any]) -> None:
    first, sharpness, display = headline(Report.from_dict(report)).splitlines()
    assert first.startswith("SNR 13.98 dB without residual, 26.02 dB with it")
    assert sharpness == (
        "sharpness 42 % (31 % in place) seen from above, 35 % (22 % in place) over all views"
    )
    assert display == ("on a display PSNR 21.25 dB without residual, 24.50 dB with it, FLIP 0.112")


def test_an_exact_fit_of_few_values(report: dict[str, Any]) -> None:
    """Of few values the model is the larger file."""
    full = Report.from_dict(report)
    exact = replace(full, snr_db=SNR(20.0, math.inf, math.inf), compression_ratio=0.4)
    line = headline(exact).splitlines()[0]
    assert "20.00 dB without residual, exact with it (bare cluster means exact)" in line
    assert "2.5 times larger" in line


def test_what_is_unknown_is_not_said(report: dict[str, Any]) -> None:
    full = Report.from_dict(report)
    bare = replace(full, sharpness=Sharpness(), display=Display())
    assert len(headline(bare).splitlines()) == 1
    without = replace(full, display=replace(full.display, flip=FLIP()))
    assert "FLIP" not in headline(without)
