"""How long a picture takes, by part: `python -m tests.benchmarks.render_sphere [--threads 2]`.

A sphere of 256 x 256 pixels with 4 eye rays each under three directional lights, of a planted model
of 256 x 256 texels with 8 lobes each; or of a run, with --run RUN.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import torch

from spmm_torch import SPMM
from spmm_torch.render import (
    Camera,
    DirectionalLight,
    Material,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from spmm_torch.render.direct import Hits, delta_light_directions
from spmm_torch.render.renderer import trace
from tests.planted.models import planted_model

LIGHTS = ((0.5, 0.5, 1.0), (-1.0, 0.3, 1.0), (0.3, -1.0, 1.5))
TEXELS, LOBES, CLUSTERS, CLUSTER_LOBES = 256, 8, 32, 24


def scene_of(repeat: float) -> Scene:
    """The sphere, straight from the front."""
    lights = tuple(DirectionalLight.build(direction) for direction in LIGHTS)
    return Scene(Sphere(Texture(repeat)), Camera.orthographic(), lights)


def best_time(work: Callable[[], object], device: str, repeats: int) -> float:
    """Seconds of the fastest of some calls, after one that warms up."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        if device != "cpu":
            torch.cuda.synchronize()
        times.append(time.perf_counter() - start)
    return min(times[1:])


@torch.no_grad()
def benchmark(
    material: Material,
    settings: RenderSettings,
    device: str = "cpu",
    repeat: float = 1.0,
    repeats: int = 3,
) -> dict[str, float]:
    """Seconds by part.

    Args:
        material: an `SPMM`, or another on `device`.
        repeat: copies of the texture in half a turn.
        repeats: of each measurement, of which the fastest counts.

    Returns:
        `whole`; `trace` (rays, hits, frames); `material`; `lobes` (the material of an `SPMM`
        without its residual); `rest`; and `queries`, their number.
    """
    scene = scene_of(repeat)
    like = torch.zeros(1, device=device)
    pixels = slice(0, settings.size**2)

    def traced() -> Hits:
        return trace(scene, settings, pixels, like)

    hits = traced()
    lights = [light for light in scene.lights if isinstance(light, DirectionalLight)]
    wi, _ = delta_light_directions(hits, lights)
    hit, number = torch.nonzero(wi[..., 2] > 0.0, as_tuple=True)
    queries = (hits.uv[hit], wi[hit, number], hits.wo[hit])
    work = {
        "whole": lambda: render(material, scene, settings, device),
        "trace": traced,
        "material": lambda: material(*queries),
    }
    if isinstance(material, SPMM):
        work["lobes"] = lambda: material(*queries, residual=False)
    seconds = {part: best_time(call, device, repeats) for part, call in work.items()}
    seconds["rest"] = seconds["whole"] - seconds["trace"] - seconds["material"]
    return {**seconds, "queries": len(hit)}


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--repeat", type=float, default=1.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    if options.run:
        model = SPMM.load(options.run, options.device)
    else:
        model = planted_model(TEXELS, LOBES, CLUSTERS, CLUSTER_LOBES, residual=0.01)
        model = model.to(options.device)
    settings = RenderSettings(options.size, options.samples)
    results = benchmark(model, settings, options.device, options.repeat, options.repeats)
    for part, value in results.items():
        print(f"{part:10} {value:10.3f} s" if part != "queries" else f"{part:10} {value:10.0f}")


if __name__ == "__main__":
    main()
