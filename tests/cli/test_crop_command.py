"""`spmm crop` cuts a zip, or refuses and leaves nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from spmm_torch.cli.main import main
from spmm_torch.data import load_btf
from tests.data.test_crop import smooth_jpeg, write_source

CORNER = ["--x=8", "--y=0", "--width=16"]


def test_a_corner(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = write_source(tmp_path / "old.zip", smooth_jpeg()), tmp_path / "new.zip"
    assert main(["crop", str(source), str(target), *CORNER, "--height=8"]) == 0
    assert capsys.readouterr().out == f"{target}\n"
    btf = load_btf(target)
    assert (btf.height, btf.width) == (8, 16)


def test_a_folder_that_is_not_there(tmp_path: Path, refused: Callable[..., str]) -> None:
    source, target = write_source(tmp_path / "old.zip", smooth_jpeg()), tmp_path / "no" / "new.zip"
    assert f"{target} cannot be written" in refused("crop", source, target, *CORNER, "--height=8")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--height=7"], "the rectangle x 8..24, y 0..7 does not fit"),
        ([], "the following arguments are required: --height; spmm crop --help tells"),
        (["--height=tall"], "'tall' is no number; expected a whole number"),
    ],
)
def test_bad_rectangles(
    tmp_path: Path, refused: Callable[..., str], words: list[str], complaint: str
) -> None:
    source = write_source(tmp_path / "old.zip", smooth_jpeg())
    assert complaint in refused("crop", source, tmp_path / "new.zip", *CORNER, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["old.zip"]
