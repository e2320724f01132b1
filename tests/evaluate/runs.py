"""Small runs of planted materials, made by the command itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from spmm_torch.cli.main import main
from spmm_torch.data import BTF
from spmm_torch.render import RenderSettings
from tests.render.planted import planted_model, tabulated

RINGS = ((0.0, 1), (20.0, 5), (40.0, 6), (60.0, 8))
# Spheres so small that they take no time; the texture is scaled as ever.
SMALL = RenderSettings(size=48, samples=1)
FAST = [
    "--config=configs/smoke.yaml",
    "--device=cpu",
    "--set=cluster.count=3",
    "--set=search.models=[lambertian, ward]",
    "--no-render",
]


def planted_btf(size: int = 6, scale: float = 0.1, seed: int = 3) -> BTF:
    """Rough texels of planted lobes, with noise that no lobe follows; HDR where values exceed 1."""
    btf = tabulated(planted_model(size, rings=RINGS, seed=seed))
    generator = torch.Generator().manual_seed(seed)
    pictures = torch.stack([btf.pictures(view) for view in range(len(btf.view))])
    noise = 0.5 + torch.rand(pictures.shape, generator=generator)
    return BTF.from_values(scale * pictures * noise, btf.view, btf.light)


def save(btf: BTF, path: Path) -> Path:
    """The BTF as NPZ."""
    values = torch.stack([btf.pictures(view) for view in range(len(btf.view))])
    np.savez(path, values=values.numpy(), view=btf.view.numpy(), light=btf.light.numpy())
    return path


def make_run(source: Path, run: Path, *options: str) -> Path:
    """A fast fit."""
    assert main(["fit", str(source), "-o", str(run), *FAST, *options]) == 0
    return run
