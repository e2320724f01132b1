"""How near the surfaces of `spmm export --to gltf` and `--to openpbr` are to the original.

FLIP on the sphere of `spmm evaluate`, against the measured BTF, beside the model, its lobes alone,
and what is commonly done: GGX and Lambert fit to the mean BRDF, with the mean colours as a map.

    python -m tests.benchmarks.exports RUN [--against INPUT]
"""

from __future__ import annotations

import argparse

from spmm_torch import SPMM
from spmm_torch.edit.parts import flattened
from spmm_torch.evaluate import open_source
from spmm_torch.export.loss import random_snr, sphere_flip
from spmm_torch.export.surface.fit import (
    Look,
    first_colours,
    fit_parameters,
    fit_surface,
    look_of,
    parameters_of,
)
from spmm_torch.export.surface.gltf import GLTFSurface
from spmm_torch.export.surface.openpbr import OpenPBRSurface
from spmm_torch.export.surface.parameters import start_of
from spmm_torch.export.surface.textured import Textured
from spmm_torch.render import BTFMaterial, Material
from spmm_torch.runtime.progress import Progress

MEAN_STEPS = 600  # one texel is fit in no time


def main() -> None:
    """Prints a line for each material."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("--against", default=None)
    options = parser.parse_args()
    source = open_source(options.run, options.against, "cpu")
    model, size = source.model, (source.model.height, source.model.width)
    source.btf.load()
    original = BTFMaterial.build(source.btf, "cpu", model.rule)
    print(
        "material                         FLIP under 3 lights        mean    SNR to the model, dB"
    )
    for name, material in materials(model).items():
        errors = sphere_flip(original, material, size, "cpu")
        assert errors is not None, "needs the extra eval"
        each = "  ".join(f"{error:.4f}" for error in errors)
        snr = random_snr(model, material)
        print(f"{name:<30}   {each}   {sum(errors) / len(errors):.4f}   {snr:6.2f}", flush=True)


def materials(model: SPMM) -> dict[str, Material]:
    """What is compared, by name."""
    look, size = look_of(flattened(model)), (model.height, model.width)
    found: dict[str, Material] = {
        "model": model,
        "its lobes alone": lambda uv, wi, wo: model(uv, wi, wo, residual=False),
        "mean BRDF, map of colours": mean_surface(look, size, model.rule),
    }
    for surface in (GLTFSurface(), OpenPBRSurface()):
        fitted = fit_surface(surface, look, Progress())
        name = f"{type(surface).__name__} {', '.join(fitted.layers)}"
        found[name] = Textured(surface, fitted.values, *size, rule=model.rule, gain=look.gain)
    return found


def mean_surface(look: Look, size: tuple[int, int], rule: str) -> Textured:
    """GGX and Lambert of the mean BRDF, whose diffuse colour follows the mean of each texel."""
    surface, mean = GLTFSurface(), look.value.mean(0, keepdim=True)
    whole = Look(look.wi, look.wo, mean, look.white, look.gain)
    parameters = parameters_of(surface, ("specular",))
    start = start_of(parameters, 1, mean) | first_colours(whole)
    values, _ = fit_parameters(surface, parameters, whole, start, MEAN_STEPS)
    colours = look.value.mean(1)
    maps = {name: value.expand(len(colours), -1) for name, value in values.items()}
    maps["base_color"] = (maps["base_color"] * colours / colours.mean(0)).clamp(max=1.0)
    return Textured(surface, maps, *size, rule=rule, gain=look.gain)


if __name__ == "__main__":
    main()
