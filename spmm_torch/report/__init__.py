"""The results of a run: `report.json` for programs and `report.html` for people."""

from __future__ import annotations

from .contract import REPORT_KEYS, Report, check_report, write_report
from .page import write_html

__all__ = ["REPORT_KEYS", "Report", "check_report", "write_html", "write_report"]
