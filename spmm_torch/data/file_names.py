"""Directions in the names of pictures: by their letters, or by a pattern that the user gives.

Names of UBO2003, ATRIUM and UTIA call the angles of light l and view v `tl`, `pl`, `tv` and `pv`, t
polar and p azimuth, in degrees. A pattern says where they stand in other names:
`L{tl}_{pl}_V{tv}_{pv}`.
"""

from __future__ import annotations

import re
from functools import lru_cache

from ..errors import ConfigError

Direction = tuple[float, float]  # (theta, phi) in degrees, as in file names
Pair = tuple[Direction, Direction]  # (view, light)

KEYS = ("tl", "pl", "tv", "pv")
# Degrees: "15", "-7.5", and "7,5" or "7p5" from where the point is written so. The number takes all
# of its digits, or a part of it would pass for an angle.
NUMBER = r"-?\d++(?:[.,pP]\d++)?+(?![.,pP]?\d)"
# "tl015", "pv_60", "tv 7.5": theta or phi of light or view, then degrees.
ANGLE = re.compile(rf"(?<![a-z])([tp][lv])[ _]*({NUMBER})", re.IGNORECASE)
# A place of a pattern, "{tl}" or "{tl:3}" of three digits; or "*", any text.
PLACE = re.compile(r"\{([^{}]*)\}|(\*)")
ANY, OPEN = "any", "open"
FIXED = re.compile(r"([a-z]+):([1-9])")
EXAMPLE = "L{tl}_{pl}_V{tv}_{pv}"
PATTERN_HELP = (
    "expected {tl}, {pl}, {tv} and {pv}, polar angle t and azimuth p of light l and view v in "
    f"degrees, as in {EXAMPLE!r}, with {{tl:3}} for exactly three digits and * for any text"
)


def parse_angles(name: str, pattern: str | None = None) -> Pair | None:
    """The directions (view, light) in a file name, in degrees; None if there are none.

    Args:
        name: file name, with its folders behind "/"; only those that the pattern names count.
        pattern: where the angles are; None: behind `tl`, `pl`, `tv` and `pv`, in any order.

    Raises:
        ConfigError: the pattern is malformed.
    """
    angle = _by_letters(name) if pattern is None else _by_pattern(name, pattern)
    if angle is None:
        return None
    return _direction(angle["tv"], angle["pv"]), _direction(angle["tl"], angle["pl"])


def _by_letters(name: str) -> dict[str, float] | None:
    found = ANGLE.findall(name.rpartition("/")[2])
    angle = {key.lower(): _degrees(value) for key, value in found}
    return angle if len(found) == len(angle) == len(KEYS) else None


def _by_pattern(name: str, pattern: str) -> dict[str, float] | None:
    matcher, keys = compiled(pattern)
    depth = pattern.count("/") + 1
    match = matcher.fullmatch("/".join(name.split("/")[-depth:]))
    if match is None:
        return None
    angle: dict[str, float] = {}
    for key, value in zip(keys, map(_degrees, match.groups()), strict=True):
        if angle.setdefault(key, value) != value:  # folder and file contradict each other
            return None
    return angle


@lru_cache(maxsize=8)
def compiled(pattern: str) -> tuple[re.Pattern[str], tuple[str, ...]]:
    """The expression of a pattern, for a name with or without suffix, and the key of each group.

    Raises:
        ConfigError: an angle is not there, a place is not known, or two have nothing between them.
    """
    expression, keys, last = "", [], 0
    before = ""  # what came just before: "" for text, ANY, or a number of any length, OPEN
    for place in PLACE.finditer(pattern):
        between = pattern[last : place.start()]
        expression += re.escape(between)
        before = "" if between else before
        last = place.end()
        if place[2]:
            expression, before = f"{expression}[^/]*?", ANY
            continue
        key, number = _place(place[1], pattern)
        if before == OPEN:
            raise _malformed(pattern, f"has nothing between two angles, at {{{key}}}")
        whole = r"(?<![\d.,-])" if before == ANY else ""  # the text takes no part of the number
        expression += f"{whole}({number})"
        before = "" if ":" in place[1] else OPEN
        keys.append(key)
    rest = pattern[last:]
    if "{" in rest or "}" in PLACE.sub("", pattern):
        raise _malformed(pattern, "has a brace without its other one")
    if missing := [key for key in KEYS if key not in keys]:
        raise _malformed(pattern, f"lacks {', '.join(f'{{{key}}}' for key in missing)}")
    # The names of pictures end in a suffix, which a pattern may leave out.
    return re.compile(rf"{expression}{re.escape(rest)}(?:\.[A-Za-z0-9]+)?"), tuple(keys)


def _place(text: str, pattern: str) -> tuple[str, str]:
    """The key of a place such as `tl` or `tl:3`, and the expression of its number."""
    fixed = FIXED.fullmatch(text)
    key, number = (text, NUMBER) if fixed is None else (fixed[1], rf"\d{{{fixed[2]}}}")
    if key not in KEYS:
        raise _malformed(pattern, f"holds {{{text}}}, which is no angle")
    return key, number


def _malformed(pattern: str, fault: str) -> ConfigError:
    return ConfigError(f"pattern {pattern!r} {fault}; {PATTERN_HELP}.")


def _degrees(text: str) -> float:
    return float(re.sub("[,pP]", ".", text))


def _direction(theta: float, phi: float) -> Direction:
    """The direction with an azimuth in [0, 360) degrees, 0 at the pole."""
    return theta, (0.0 if theta == 0.0 else phi % 360.0)
