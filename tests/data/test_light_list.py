"""Lists of lights: what a line may look like, and one sentence for each fault."""

from __future__ import annotations

import pytest

from spmm_torch.data.light_list import Light, parse_intensities, parse_lights
from spmm_torch.errors import DataError

TILTED = (0.6, 0.0, 0.8)


def light(name: str, intensity: tuple[float, ...] = (), line: int = 2) -> Light:
    return Light(line, name, TILTED, intensity)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("a.jpg 0.6 0 0.8", light("a.jpg")),
        ("  a.JPG\t+0.6\t-0.0\t8e-1  ", light("a.JPG")),
        ("a.jpg 60 0 80", light("a.jpg")),  # positions, or directions of any length
        ("my light 1 0 2.png 0.6 0 0.8", light("my light 1 0 2.png")),
        ('"C:\\rti set\\a 1.png" 0.6 0 0.8', light("C:\\rti set\\a 1.png")),
        ("a.jpg, 0.6, 0, 0.8", light("a.jpg")),
        ("a.jpg 0.6,0,0.8", light("a.jpg")),
        ("a.jpg;0.6;0;0.8", light("a.jpg")),
        ("a.jpg 0,6 0 0,8", light("a.jpg")),  # decimal commas
        ("a.jpg 0.6 0 0.8 1.5", light("a.jpg", (1.5,))),
        ("a.jpg 0,6 0 0,8 1,5", light("a.jpg", (1.5,))),
        ("a.jpg 0.6 0 0.8 1 2 4", light("a.jpg", (1.0, 2.0, 4.0))),
        ("a 1 0.6 0 0.8", light("a 1")),  # without a suffix
        ("raw/a.dng 0.6 0 0.8", light("raw/a.dng")),
    ],
)
def test_lines(line: str, expected: Light) -> None:
    (found,) = parse_lights(f"\n 1 \n{line}\n\n", "x.lp")
    assert (found.picture, found.intensity) == (expected.picture, expected.intensity)
    assert found.direction == pytest.approx(TILTED)
    assert found.line == 3


def test_lights_at_the_horizon() -> None:
    (found,) = parse_lights("1\na.jpg 1 0 -1e-5", "x.lp")
    assert found.direction[2] == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "x.lp is empty; expected the number of lights in the first line"),
        ("a.jpg 0 0 1\n", "x.lp starts with 'a.jpg 0 0 1'; expected the number of lights"),
        ("2\na.jpg 0 0 1\n", "x.lp says 2 lights in its first line, but names 1"),
        ("0\na.jpg 0 0 1\n", "x.lp says 0 lights in its first line, but names 1"),
        ("1\na.jpg 0 1\n", "line 2 of x.lp is 'a.jpg 0 1'; expected the name of a picture, x, y"),
        ("1\na.jpg 0 0 up\n", "line 2 of x.lp is 'a.jpg 0 0 up'; expected the name"),
        ("1\na.jpg 0 0 1 2 3\n", "line 2 of x.lp is 'a.jpg 0 0 1 2 3'; expected the name"),
        ("1\na.jpg 0 0 0\n", r"line 2 of x.lp has the light \(0.0, 0.0, 0.0\); expected a dir"),
        ("1\na.jpg 0 nan 1\n", "line 2 of x.lp has the light .*; expected a direction"),
        (
            "1\na.jpg 0.6 0 -0.8\n",
            r"line 2 of x.lp has a light under the horizon, \(0.6, 0.0, -0.8",
        ),
        (
            "1\na.jpg 0 0 1 0\n",
            "line 2 of x.lp has the intensity 0; expected a finite number above",
        ),
        ("1\na.jpg 0 0 1 1 inf 1\n", "line 2 of x.lp has the intensity inf; expected a finite"),
    ],
)
def test_faults(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_lights(text, "x.lp")


def test_intensities() -> None:
    assert parse_intensities("1.5\n\n2 3 4\n", "i.txt", 2) == [(1.5,), (2.0, 3.0, 4.0)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1\n2\n", "i.txt has intensities of 2 lights, but the list names 3"),
        ("1\n2 3\n4\n", "line 2 of i.txt is '2 3'; expected one intensity, or three by channel"),
        ("1\n-2\n4\n", "line 2 of i.txt has the intensity -2; expected a finite number above 0"),
    ],
)
def test_faults_of_intensities(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_intensities(text, "i.txt", 3)
