"""Directions in file names: by letters, and by a pattern that the user gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.data.file_names import parse_angles
from spmm_torch.errors import ConfigError, DataError
from tests.data.test_picture_set import linear, make_files, write_zip

CODES = np.random.default_rng(1).integers(0, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
PATTERN = "L{tl}_{pl}_V{tv}_{pv}"
UTIA_VIEW = "tv015_pv060"


@pytest.mark.parametrize("theta", ["23.5", "23,5", "23p5", "23P50", "023,500"])
def test_points_of_any_kind(theta: str) -> None:
    expected = (30.0, 7.25), (23.5, 90.0)
    assert parse_angles(f"tl{theta}_pl090_tv030_pv7,25.jpg") == expected
    assert parse_angles(f"L{theta}_090_V30_7.25.jpg", PATTERN) == expected


@pytest.mark.parametrize("theta", ["23,5,1", "23.5.1", "23,5p1"])
def test_no_part_of_a_number_passes_for_an_angle(theta: str) -> None:
    assert parse_angles(f"L{theta}_090_V30_7.jpg", PATTERN) is None
    assert parse_angles(f"tl{theta}_pl090_tv030_pv7.jpg") is None


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        (PATTERN, "L15_60_V75_345.png"),
        (PATTERN, "a/b/L015_060_V75.0_-15.tiff"),
        (f"{PATTERN}.png", "L15_60_V75_345.png"),
        ("{tl}_{pl}_{tv}_{pv}", "15_60_75_345.exr"),
        ("*_{tl}_{pl}_{tv}_{pv}", "0001_15_60_75_345.exr"),
        ("img*-{tv}-{pv}-{tl}-{pl}*", "img12-75-345-15-60-b.exr"),
        ("{tl:3}{pl:3}{tv:3}{pv:3}", "015060075345.png"),
        ("V{tv}_{pv}/{tl}_{pl}", "set 1/V75_345/15_60.png"),
        ("V{tv}_{pv}/*{tl}_{pl}_{tv}", "V75_345/no 15_60_75.0.png"),
        ("({tl}+{pl}) [{tv}-{pv:3}]", "(15+60) [75-345].png"),
    ],
)
def test_patterns(pattern: str, name: str) -> None:
    assert parse_angles(name, pattern) == ((75.0, 345.0), (15.0, 60.0))


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("{tl}_{pl}_{tv}_{pv}", "0001_15_60_75_345.exr"),  # a number in front of the angles
        ("{tl}_{pl}_{tv}_{pv}", "15_60_75_345_2.exr"),
        (PATTERN, "tl015 pl060 tv075 pv345.jpg"),  # letters do not count beside a pattern
        ("V{tv}_{pv}/{tl}_{pl}_{tv}", "V75_345/15_60_30.png"),  # the folder says something else
        ("V{tv}_{pv}/{tl}_{pl}", "15_60.png"),
        ("{tl:3}{pl:3}{tv:3}{pv:3}", "15060075345.png"),
    ],
)
def test_names_unlike_the_pattern(pattern: str, name: str) -> None:
    assert parse_angles(name, pattern) is None


@pytest.mark.parametrize(
    ("pattern", "fault"),
    [
        ("L{tl}_{pl}_V{tv}", "lacks {pv}"),
        ("", "lacks {tl}, {pl}, {tv}, {pv}"),
        ("tl pl tv pv", "lacks {tl}, {pl}, {tv}, {pv}"),
        ("{tl}{pl}_{tv}_{pv}", "has nothing between two angles, at {pl}"),
        ("{theta}_{tl}_{pl}_{tv}_{pv}", "holds {theta}, which is no angle"),
        ("{tl:0}_{pl}_{tv}_{pv}", "holds {tl:0}, which is no angle"),
        ("{}{tl}_{pl}_{tv}_{pv}", "holds {}, which is no angle"),
        ("{tl}_{pl}_{tv}_{pv", "has a brace without its other one"),
        ("{tl}_{pl}_{tv}_{pv}}", "has a brace without its other one"),
    ],
)
def test_malformed_patterns(tmp_path: Path, pattern: str, fault: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_btf(tmp_path, pattern=pattern)
    assert str(error.value).startswith(f"pattern {pattern!r} {fault}; expected {{tl}}, {{pl}}")


def named(n: int, tl: int, pl: int, tv: int, pv: int) -> str:
    return f"wool/{n}/L{tl}_{pl}_V{tv}_{pv}.png"


def test_a_set_read_by_a_pattern(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "a.zip", make_files(CODES, name=named))
    torch.testing.assert_close(load_btf(path, pattern=PATTERN).texels(), linear(CODES))
    with pytest.raises(DataError, match="give the pattern of its names with --pattern"):
        load_btf(path)
    with pytest.raises(DataError, match="the first one is 'wool/0/L0_0_V0_0.png'; expected names"):
        load_btf(path, pattern=f"x{PATTERN}")


def test_a_pattern_goes_before_letters(tmp_path: Path) -> None:
    def misleading(n: int, tl: int, pl: int, tv: int, pv: int) -> str:
        return f"tl{tv} pl{pv} tv{tl} pv{pl}.png"  # light and view exchanged

    path = write_zip(tmp_path / "a.zip", make_files(CODES, name=misleading))
    exchanged = load_btf(path, pattern="tl{tv} pl{pv} tv{tl} pv{pl}")
    torch.testing.assert_close(exchanged.texels(), linear(CODES))


def test_a_pattern_does_nothing_to_other_formats(tmp_path: Path) -> None:
    values = np.ones((1, 1, 2, 2, 3), np.float32)
    up = np.array([[0.0, 0.0, 1.0]])
    np.savez(tmp_path / "a.npz", values=values, view=up, light=up)
    assert load_btf(tmp_path / "a.npz", pattern=PATTERN).texels().shape == (4, 1, 3)


def test_utia_names(tmp_path: Path) -> None:
    """Names of the UTIA BTF database: http://btf.utia.cas.cz, page "Data description"."""

    def utia(n: int, tl: int, pl: int, tv: int, pv: int) -> str:
        return f"tv{tv:03}_pv{pv:03}/tl{tl:03}_pl{pl:03}_tv{tv:03}_pv{pv:03}.png"

    files = make_files(CODES, name=utia)
    assert any(name.startswith(f"{UTIA_VIEW}/") for name, _ in files)
    path = write_zip(tmp_path / "fabric01.zip", files)
    torch.testing.assert_close(load_btf(path).texels(), linear(CODES))
