"""Small runs: folders that hold a planted model, and fits by the command itself."""

from __future__ import annotations

import json
from pathlib import Path

from spmm_torch import BTF, SPMM
from spmm_torch.cli.main import main
from spmm_torch.data import write_npz
from spmm_torch.runtime.tensor_file import MODEL_FILE
from tests.locations import CONFIGS
from tests.planted.models import planted_model

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


def newer_run(folder: Path) -> Path:
    """A run of a version that is not known; it is made."""
    run = model_folder(folder, planted_model(size=2, lobes_per_texel=1))
    file = run / MODEL_FILE
    content = file.read_bytes()
    size = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + size])
    header["__metadata__"]["version"] = "99"
    text = json.dumps(header).encode()
    file.write_bytes(len(text).to_bytes(8, "little") + text + content[8 + size :])
    return run


def save(btf: BTF, path: Path) -> Path:
    """The BTF as NPZ."""
    write_npz(path, btf)
    return path


def make_run(source: Path, run: Path, *options: str) -> Path:
    """A fast fit."""
    assert main(["fit", str(source), "-o", str(run), *FAST, *options]) == 0
    return run
