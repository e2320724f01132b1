"""Lists of lights, `.lp`: one picture a line with the direction of its light.

The first line is the number of lights. Each other line is the name of a picture, which may have
blanks, and x, y, z of its light: x right, y up, z towards the camera, of any length. One more
number is the intensity of the light, or three are by channel. In place of these,
`light_intensities.txt` beside the list may hold one line of one or three numbers a light, as
photometric-stereo sets do.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import DataError
from .codecs import SUFFIXES
from .directions import HORIZON_TOLERANCE

# A name that ends in the suffix of a picture, with or without quotes; then numbers.
NAMED = re.compile(
    rf"""\s*["']?(.*(?:{"|".join(map(re.escape, SUFFIXES))}))["']?[\s,;]+(.*)""", re.IGNORECASE
)
# Any other name: only the last three words are numbers.
UNNAMED = re.compile(r"\s*(.*\S)\s+(\S+\s+\S+\s+\S+)\s*")
COUNT = re.compile(r"\s*(\d+)\s*")
DECIMAL_COMMAS = re.compile(r"[-+]?\d+,\d+(?:\s+[-+]?\d+(?:,\d+)?)*\s*")
ENTRY_HELP = "the name of a picture, x, y and z of its light, and perhaps its intensity or three"


@dataclass(frozen=True)
class Light:
    """One light of a list.

    Attributes:
        line: number of its line, from 1.
        picture: name of its picture.
        direction: unit vector to it.
        intensity: its intensity, none, one or one for each channel.
    """

    line: int
    picture: str
    direction: tuple[float, float, float]
    intensity: tuple[float, ...]


def parse_lights(text: str, where: str) -> list[Light]:
    """The lights of a list.

    Args:
        text: content of the file.
        where: name of the file in messages.

    Raises:
        DataError: the count is not that of the lines, a line is malformed, or a light is under the
            horizon.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    count = COUNT.fullmatch(lines[0][1]) if lines else None
    if count is None:
        first = f"starts with {lines[0][1]!r}" if lines else "is empty"
        raise DataError(
            f"{where} {first}; expected the number of lights in the first line, then one line a "
            f"light: {ENTRY_HELP}; add the number."
        )
    lights = [_light(line, number, where) for number, line in lines[1:]]
    if len(lights) != int(count[1]):
        raise DataError(
            f"{where} says {count[1]} lights in its first line, but names {len(lights)}; expected "
            f"the same number; restore the file if it was cut, or mend the number."
        )
    return lights


def _light(line: str, number: int, where: str) -> Light:
    match = NAMED.fullmatch(line) or UNNAMED.fullmatch(line)
    numbers = _numbers(match[2]) if match else None
    if match is None or numbers is None or len(numbers) not in (3, 4, 6):
        raise DataError(
            f"line {number} of {where} is {line.strip()!r}; expected {ENTRY_HELP}; mend the line."
        )
    place = f"line {number} of {where}"
    direction, intensity = _direction(numbers[:3], place), tuple(numbers[3:])
    check_intensity(intensity, place)
    return Light(number, match[1].strip(), direction, intensity)


def _direction(vector: Sequence[float], place: str) -> tuple[float, float, float]:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and length > 0.0):
        raise DataError(
            f"{place} has the light {tuple(vector)}; expected a direction, three finite "
            f"numbers that are not all 0; mend the line."
        )
    x, y, z = (value / length for value in vector)
    if z < -HORIZON_TOLERANCE:
        raise DataError(
            f"{place} has a light under the horizon, {tuple(vector)}; expected z of 0 or more, as "
            f"z points from the surface to the camera; turn the axes, or remove the line."
        )
    return x, y, max(z, 0.0)


def check_intensity(intensity: Sequence[float], place: str) -> None:
    """Refuses intensities by which no value can be divided.

    Raises:
        DataError: one is not a finite number above 0.
    """
    for value in intensity:
        if not (math.isfinite(value) and value > 0.0):
            raise DataError(
                f"{place} has the intensity {value:g}; expected a finite number above 0; mend it, "
                f"or remove the light."
            )


def parse_intensities(text: str, where: str, count: int) -> list[tuple[float, ...]]:
    """The intensities of `count` lights, one line of one or three numbers for each.

    Raises:
        DataError: there are more or fewer, or a line is malformed.
    """
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        values = _numbers(line)
        if values is None or len(values) not in (1, 3):
            raise DataError(
                f"line {number} of {where} is {line.strip()!r}; expected one intensity, or three "
                f"by channel; mend the line."
            )
        check_intensity(values, f"line {number} of {where}")
        found.append(tuple(values))
    if len(found) != count:
        raise DataError(
            f"{where} has intensities of {len(found)} lights, but the list names {count}; expected "
            f"one line for each; mend the file, or remove it."
        )
    return found


def _numbers(text: str) -> list[float] | None:
    """Numbers between blanks, commas or semicolons, or with decimal commas; None if malformed."""
    text = text.strip().strip(",;")
    if DECIMAL_COMMAS.fullmatch(text):
        text = text.replace(",", ".")
    try:
        return [float(part) for part in re.split(r"[\s,;]+", text)]
    except ValueError:
        return None
