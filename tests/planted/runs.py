"""Small runs: folders that hold a planted model, and fits by the command itself."""

from __future__ import annotations

from pathlib import Path

from spmm_torch import BTF, SPMM
from spmm_torch.cli.main import main
from spmm_torch.data import write_npz
from spmm_torch.runtime.tensor_file import MODEL_FILE
from tests.locations import CONFIGS

FAST = [
    f"--config={CONFIGS / 'smoke.yaml'}",
    "--device=cpu",
    "--set=cluster.count=3",
    "--set=search.models=[lambertian, ward]",
    "--no-render",
]


def model_folder(folder: Path, model: SPMM) -> Path:
    """A run folder with nothing but the model; it is made."""
    folder.mkdir()
    (folder / MODEL_FILE).write_bytes(model.pack())
    return folder


def save(btf: BTF, path: Path) -> Path:
    """The BTF as NPZ."""
    write_npz(path, btf)
    return path


def make_run(source: Path, run: Path, *options: str) -> Path:
    """A fast fit."""
    assert main(["fit", str(source), "-o", str(run), *FAST, *options]) == 0
    return run
