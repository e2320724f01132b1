"""Models for other programs: one module for each target, with a function `write`.

A new target is one module and one entry in `TARGETS`, which are listed without torch.
"""

from __future__ import annotations

from .target import LOBES, PARTS, RELIEF, RESIDUAL, Exported, NoSettings, Target

__all__ = [
    "LOBES",
    "PARTS",
    "RELIEF",
    "RESIDUAL",
    "TARGETS",
    "Exported",
    "NoSettings",
    "Target",
]

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        Target(
            "exr",
            "all numbers of the model as planes of one OpenEXR file, for engines",
            ".exr",
            (LOBES, RESIDUAL, RELIEF),
        ),
        Target(
            "osl",
            "a shader of closures for Blender Cycles, with the pictures that it reads",
            "",
            (LOBES, RELIEF),
        ),
        Target(
            "web",
            "one offline HTML page that shows the material in real time by WebGL 2",
            ".html",
            (LOBES, RESIDUAL, RELIEF),
        ),
        Target(
            "gltf",
            "a sphere with one metallic-roughness surface a texel, fit to the lobes",
            ".glb",
            (),
        ),
        Target(
            "openpbr",
            "a MaterialX file with one OpenPBR surface a texel, fit to the lobes",
            "",
            (RELIEF,),
        ),
    )
}
