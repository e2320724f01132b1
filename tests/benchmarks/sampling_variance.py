"""Variance of our sampling against a cosine lobe: `python -m tests.benchmarks.sampling_variance`.

A sphere by either sampler alone, at equal sample count and at equal time, under light from
everywhere and in the studio: of a planted glossy material, and of a fit of TILES64 (made here with
the default settings, or given with --run RUN). The bounds: 20 at equal count, 10 at equal time.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from spmm_torch import SPMM, load_btf
from spmm_torch.figures.sampling import sphere_hits, variance_gains
from spmm_torch.figures.variance import some_hits, white_light
from spmm_torch.fit import fit
from spmm_torch.render import EnvironmentLight, RenderSettings
from tests.locations import DATA
from tests.planted.models import planted_model

TILES = DATA / "TILES64.zip"
SIZE, HITS, SAMPLES = 128, 512, 1024
BOUNDS = {"equal_count": 20.0, "equal_time": 10.0}
# Lobes of the planted material: a diffuse base under two glossy coats.
COATS = ("lambertian", "ward", "cook_torrance")
# Its coats are that much narrower than planted lobes are by default: slopes of 0.02 to 0.07,
# highlights some degrees wide.
NARROWER = 0.4


def glossy_model(size: int = 64) -> SPMM:
    """Planted texels of three lobes each, out of nine of a cluster, near the normal."""
    model = planted_model(size, lobes_per_texel=3, lobes_per_cluster=9, names=COATS)
    names = model.dictionary.names()
    for column, wanted in ((0, ("ward", "cook_torrance")), (1, ("ward",))):
        rows = torch.tensor([name in wanted for name in names])
        model.kappa.data[rows, column] *= NARROWER
    return model


def measure(name: str, model: SPMM, device: str) -> None:
    """Prints a row for each light."""
    model = model.to(device)
    hits = some_hits(sphere_hits(model, RenderSettings(SIZE, 1)), HITS, 0)
    for light_name, light in (("white", white_light()), ("studio", EnvironmentLight.studio())):
        placed = light.to(device, model.weight.dtype)
        found = variance_gains(model, hits, placed, SAMPLES, 0)
        gains = found["gain"]
        met = all(gains[key] >= bound for key, bound in BOUNDS.items())
        print(
            f"{name:<16} {light_name:<8} variance / {gains['equal_count']:8.1f} at equal count, "
            f"/ {gains['equal_time']:8.1f} at equal time; a sample takes "
            f"{1e6 * found['spmm']['seconds']:.2f} us, of the cosine lobe "
            f"{1e6 * found['cosine']['seconds']:.2f} us; bounds {'met' if met else 'missed'}",
            flush=True,
        )


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, help="run of a glossy material, instead of TILES64")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    measure("planted glossy", glossy_model(), options.device)
    if options.run:
        measure(options.run.name, SPMM.load(options.run), options.device)
    elif TILES.is_file():
        measure("TILES64", fit(load_btf(TILES), render=False).model, options.device)
    else:
        print(f"TILES64 skipped: {TILES} is missing; give a run of another material with --run.")


if __name__ == "__main__":
    main()
