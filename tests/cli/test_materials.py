"""A folder of tables through the command line: one fit, one report, names kept, and converted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.cli.main import main
from spmm_torch.data import load_btf
from tests.data.brdf_tables.made_files import rgl_tensors, tensor_bytes, write

QUICK = (
    "search.models=[lambertian]",
    "search.max_lobes=1",
    "residual.rank=0",
    "cluster.count=2",
)


def table(value: float) -> bytes:
    """An RGL table of one value at all pairs."""
    tensors = rgl_tensors(np.zeros(1), jacobian=0)
    return tensor_bytes(tensors | {"rgb": np.full_like(tensors["rgb"], value)})


def test_a_folder_is_one_run_with_names(tmp_path: Path) -> None:
    for name, value in (("wax", 0.2), ("tin", 0.4), ("oak", 0.1)):
        write(tmp_path / "in" / f"{name}_rgb.bsdf", table(value))
    changes = [part for change in QUICK for part in ("--set", change)]
    run = tmp_path / "run"
    assert main(["fit", str(tmp_path / "in"), "-o", str(run), *changes]) == 0
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    assert report["texels"] == 3
    assert [row["name"] for row in report["materials"]] == ["oak_rgb", "tin_rgb", "wax_rgb"]
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "3 materials" in page
    assert "Texture slices" not in page
    assert "relief" not in (run / "log.txt").read_text(encoding="utf-8")


def test_conversion_keeps_names_and_directions(tmp_path: Path) -> None:
    for name, value in (("wax", 0.2), ("tin", 0.4)):
        write(tmp_path / "in" / f"{name}.bsdf", table(value))
    target = tmp_path / "out.npz"
    assert main(["convert", str(tmp_path / "in"), "-o", str(target), "--rings", "151"]) == 0
    btf = load_btf(target)
    assert btf.names == ("tin", "wax")
    assert len(btf.view) == len(btf.light) == 151
    np.testing.assert_allclose(btf.texels().numpy(), [[[0.4]], [[0.2]]] + 0 * btf.texels().numpy())


def test_a_damaged_table_ends_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "in" / "gold.binary", b"too short")
    assert main(["fit", str(tmp_path / "in"), "-o", str(tmp_path / "run")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert "'gold.binary' in" in lines[-1]
    assert "expected 34,992,012 bytes" in lines[-1]
    assert not (tmp_path / "run").exists()
