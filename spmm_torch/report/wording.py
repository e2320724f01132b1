"""Numbers as text for people; an unknown value is a dash."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..runtime.progress import MINUTE, duration

UNKNOWN = "–"
# Seconds below which milliseconds are shown.
SHORT = 0.1
# Units of the paper, where 32 x 81^2 x 3 x 4 bytes are "2.40 MB" [WDR11 §4.2].
KILOBYTE, MEGABYTE, GIGABYTE = 1 << 10, 1 << 20, 1 << 30


def decibels(value: float | None) -> str:
    """`7.31 dB`."""
    if value is None or math.isnan(value):
        return UNKNOWN
    return "exact" if value == math.inf else f"{signed(value, '.2f')} dB"


def signed(value: float, form: str) -> str:
    """A number in a format of Python's, with a true minus sign."""
    return format(value, form).replace("-", "−")


def fixed(value: float | None, decimals: int) -> str:
    """A number with `decimals` decimals; a dash where it is not finite."""
    return UNKNOWN if value is None or not math.isfinite(value) else signed(value, f".{decimals}f")


def percent(fraction: float | None, decimals: int = 1) -> str:
    """`12.3 %` of a fraction of 1."""
    return UNKNOWN if fraction is None else f"{fixed(100.0 * fraction, decimals)} %"


def size(count: float | None) -> str:
    """Bytes as `812 bytes`, `73.8 kB`, `1.20 GB`."""
    if count is None:
        return UNKNOWN
    for unit, name in ((GIGABYTE, "GB"), (MEGABYTE, "MB"), (KILOBYTE, "kB")):
        if count >= unit:
            return f"{three_figures(count / unit)} {name}"
    return f"{count:.0f} bytes"


def three_figures(value: float) -> str:
    """At least three figures, and no more decimals than that needs: `2.40`, `73.8`, `512`."""
    decimals = 2 if value < 9.995 else 1 if value < 99.95 else 0
    return f"{value:,.{decimals}f}"


def seconds(value: float | None) -> str:
    """`0.84 s`, `42.1 s`, `3 min 05 s`."""
    if value is None:
        return UNKNOWN
    if value >= MINUTE:
        return duration(value)
    return f"{value:.2f} s" if value < 1.0 else f"{value:.1f} s"


def short_seconds(value: float) -> str:
    """`84.0 ms` below a tenth of a second, and `seconds` above."""
    return f"{three_figures(1e3 * value)} ms" if value < SHORT else seconds(value)


def median_time(times: Mapping[str, float]) -> str:
    """`1.2 s ± 5 %`: the median of some runs, and half of their range where there are several.

    Args:
        times: `median`, `fastest` and `slowest` in seconds, and the number of `runs`.
    """
    text = short_seconds(times["median"])
    if times["runs"] == 1:
        return text
    half_range = 0.5 * (times["slowest"] - times["fastest"])
    return f"{text} ± {100.0 * half_range / times['median']:.0f} %"


def ratio(value: float | None) -> str:
    """A compression ratio as `1:98`."""
    if value is None:
        return UNKNOWN
    return f"1:{value:,.0f}" if value >= 10.0 else f"1:{value:.1f}"


def times_smaller(ratio: float) -> str:
    """A compression ratio as `37 times smaller`, or `2.5 times larger` below 1."""
    times, word = (ratio, "smaller") if ratio >= 1.0 else (1.0 / ratio, "larger")
    return f"{times:,.{0 if times >= 10.0 else 1}f} times {word}"


def number(value: float | None) -> str:
    """`12,345`, or `6.53` if it is not whole."""
    if value is None:
        return UNKNOWN
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:,.2f}"


def plural(count: int, noun: str) -> str:
    """`1 texel`, `4,096 texels`."""
    return f"{count:,} {noun}" + ("" if count == 1 else "s")
