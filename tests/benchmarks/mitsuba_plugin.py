"""Mitsuba with the plug-in `spmm`: `python -m tests.benchmarks.mitsuba_plugin [RUN]`.

Seconds of all cores for a sphere of 256 x 256 pixels at 64 samples under an environment, with four
texels a lookup and with one, against `diffuse` and `principled` in the same scene; and the relative
error of the converged picture against our renderer, under three directional lights. Of a planted
model of 64 x 64 texels with 6 lobes each, or of a run.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from spmm_torch import SPMM
from spmm_torch.config.synthesis import FAST
from spmm_torch.mitsuba import register
from spmm_torch.mitsuba.material import FILTERS
from spmm_torch.render import (
    Camera,
    DirectionalLight,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from tests.mitsuba.scenes import as_on_our_sphere, sphere_scene, sun
from tests.planted.models import planted_model, with_components

SIZE, SAMPLES, REPEATS = 256, 64, 3
CONVERGED = 256
LIGHTS = ((0.5, 0.5, 1.0), (-1.0, 0.3, 1.0), (0.3, -1.0, 1.5))


def processor_seconds() -> float:
    """Seconds of all threads so far, which other programs hardly change."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def environment(mi: Any) -> dict[str, Any]:
    """An environment of some bright pixels."""
    pixels = np.random.default_rng(0).random((64, 128, 3)).astype(np.float32) ** 8
    return {"sky": {"type": "envmap", "bitmap": mi.Bitmap(pixels)}}


def seconds(mi: Any, bsdf: dict[str, Any]) -> tuple[float, float]:
    """(seconds of the first picture, with its compilation; of the fastest one after it)."""
    scene = sphere_scene(mi, bsdf, environment(mi), SIZE)
    integrator = mi.load_dict({"type": "path", "max_depth": 2})
    times = []
    for seed in range(REPEATS + 1):
        start = processor_seconds()
        np.array(mi.render(scene, integrator=integrator, spp=SAMPLES, seed=seed))
        times.append(processor_seconds() - start)
    return times[0], min(times[1:])


def error(mi: Any, bsdf: dict[str, Any], model: SPMM) -> float:
    """Relative error of the whole picture against our renderer."""
    found = np.zeros((SIZE, SIZE, 3))
    for light in LIGHTS:  # one alone: to choose among them would be noise
        scene = sphere_scene(mi, bsdf, {"sun": sun(light)}, SIZE)
        found += np.array(mi.render(scene, spp=CONVERGED, seed=0))
    lights = tuple(DirectionalLight.build(light) for light in LIGHTS)
    scene = Scene(Sphere(Texture()), Camera.orthographic(), lights)
    expected = render(model, scene, RenderSettings(SIZE, CONVERGED)).picture.numpy()
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def main() -> None:
    """Prints all figures."""
    import mitsuba as mi

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", nargs="?", help="run folder or model file")
    run = parser.parse_args().run
    mi.set_variant(FAST)
    register()
    with tempfile.TemporaryDirectory() as folder:
        if run is None:
            run = Path(folder) / "model.safetensors"
            with_components(planted_model(size=64, lobes_per_texel=6), rank=16).save(run)
        bsdf = {"type": "spmm", "filename": str(run), "to_uv": as_on_our_sphere(mi)}
        materials = {name: {"type": name} for name in ("diffuse", "principled")}
        materials |= {f"spmm, {name}": {**bsdf, "filter_type": name} for name in FILTERS}
        for name, material in materials.items():
            first, then = seconds(mi, material)
            print(f"{name:<17} {then:.2f} s, the first picture {first:.2f} s")
        print(f"relative error against our renderer {error(mi, bsdf, SPMM.load(run)):.5f}")


if __name__ == "__main__":
    main()
