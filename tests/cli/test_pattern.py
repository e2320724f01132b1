"""Names of pictures by a pattern, in every command that reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.cli.main import main
from spmm_torch.config.fit import FitConfig
from spmm_torch.data import load_btf
from tests.cli.test_resume import OPTIONS
from tests.data.test_picture_set import make_files, write_zip

PATTERN = "L{tl}_{pl}_V{tv}_{pv}"
OTHER = "{tv}-{pv}-{tl}-{pl}"
CODES = np.random.default_rng(1).integers(60, 90, (3, 3, 4, 4, 3), dtype=np.uint8)


def named(pattern: str) -> Callable[..., str]:
    def name(n: int, tl: int, pl: int, tv: int, pv: int) -> str:
        return f"{pattern.format(tl=tl, pl=pl, tv=tv, pv=pv)}.png"

    return name


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    return write_zip(tmp_path / "wool.zip", make_files(CODES, name=named(PATTERN)))


def test_a_run_keeps_its_pattern(pictures: Path, tmp_path: Path, refused: Callable) -> None:
    run = tmp_path / "run"
    assert "--pattern" in refused("fit", pictures, "-o", run, *OPTIONS)
    assert main(["fit", str(pictures), "-o", str(run), *OPTIONS, "--pattern", PATTERN]) == 0
    assert FitConfig.from_yaml(run / "config.yaml").data.pattern == PATTERN
    assert main(["evaluate", str(run)]) == 0
    figures = json.loads((run / "evaluation.json").read_text(encoding="utf-8"))
    assert figures["report_difference_db"] < 0.01
    copy = write_zip(tmp_path / "copy.zip", make_files(CODES, name=named(OTHER)))
    wrong = refused("evaluate", run, "--against", copy)
    assert f"expected names like the pattern {PATTERN!r}" in wrong
    assert main(["evaluate", str(run), "--against", str(copy), "--pattern", OTHER]) == 0


def test_convert_and_render(pictures: Path, tmp_path: Path) -> None:
    named_so = ["--pattern", PATTERN]
    assert main(["convert", str(pictures), "-o", str(tmp_path / "a.npz"), *named_so]) == 0
    expected = load_btf(pictures, pattern=PATTERN).texels()
    assert load_btf(tmp_path / "a.npz").texels().equal(expected)
    picture = ["-o", str(tmp_path / "a.png"), "--size", "8", "--shape", "plane"]
    assert main(["render", "--input", str(pictures), *picture, *named_so]) == 0


@pytest.mark.parametrize(
    "words", [["fit", "-o", "run"], ["convert", "-o", "a.npz"], ["render", "-o", "a.png"]]
)
def test_a_malformed_pattern(
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable,
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    source = ["--input", pictures] if words[0] == "render" else [pictures]
    sentence = refused(*words, *source, "--pattern", "L{tl}_{pl}_V{tv}")
    assert sentence.startswith("pattern 'L{tl}_{pl}_V{tv}' lacks {pv}; expected {tl}, {pl}, {tv}")
    assert not (tmp_path / words[2]).exists()
