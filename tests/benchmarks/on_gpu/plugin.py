"""The part that renders with Mitsuba, where it is installed: the plug-in `spmm` on the device."""

from __future__ import annotations

import tempfile
from pathlib import Path

import torch

from spmm_torch import SPMM
from spmm_torch.config.synthesis import FAST
from spmm_torch.synthesize.variant import works
from tests.benchmarks.on_gpu.made_up import model
from tests.benchmarks.on_gpu.measuring import measured
from tests.benchmarks.on_gpu.needs import absent
from tests.benchmarks.on_gpu.rows import Put, Row
from tests.benchmarks.on_gpu.sizes import Sizes
from tests.benchmarks.on_gpu.uses import queries

VARIANTS = {"cuda": "cuda_ad_rgb", "cpu": FAST}
SAMPLES = 64


def pictures(device: str, sizes: Sizes, put: Put) -> None:
    """A sphere under an environment, of `principled` and of the plug-in; and how its values differ.

    Raises:
        AssertionError: values of the plug-in are not those of torch.
    """
    variant = VARIANTS[device]
    if absent({"mitsuba": "mitsuba"}) or not works(variant):
        put(Row("Mitsuba", note=f"skipped: Mitsuba is not installed, or without {variant}"))
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "model.safetensors"
        made = model(sizes.texture)
        made.save(place)
        difference = _difference(made, place, variant, sizes)
        _measure(place, torch.device(device), sizes, put, f"values differ by {difference:.1e}")
    assert difference < 1e-3, f"values differ by {difference:.1e} of their norm"


@torch.no_grad()
def _difference(made: SPMM, place: Path, variant: str, sizes: Sizes) -> float:
    """Difference of values by the plug-in from those by torch on the CPU, over their norm."""
    from spmm_torch.mitsuba.evaluation import PluginMaterial

    uv, wi, wo, _ = queries(sizes.batch, "cpu")
    expected = made(uv, wi, wo)
    found = PluginMaterial(place, variant)(uv, wi, wo)
    return float((found - expected).norm() / expected.norm())


def _measure(place: Path, device: torch.device, sizes: Sizes, put: Put, note: str) -> None:
    """Puts a row for each material, in the variant that is set."""
    import mitsuba as mi
    import numpy as np

    from tests.benchmarks.mitsuba_plugin import environment
    from tests.mitsuba.scenes import as_on_our_sphere, sphere_scene

    ours = {"type": "spmm", "filename": str(place), "to_uv": as_on_our_sphere(mi)}
    path = mi.load_dict({"type": "path", "max_depth": 2})
    for bsdf, words in (({"type": "principled"}, ""), (ours, note)):
        scene = sphere_scene(mi, bsdf, environment(mi), sizes.picture)
        label = f"Mitsuba, {bsdf['type']}, {sizes.picture} x {sizes.picture} at {SAMPLES} samples"
        work = lambda scene=scene: np.array(mi.render(scene, integrator=path, spp=SAMPLES))  # noqa: E731
        measured(label, work, device, sizes.patience, put, note=words)
