"""Fig. 3: renderings of the BTF and of its model, pair by pair [WDR11 Fig. 3]."""

from __future__ import annotations

import math

from ..render import (
    BTFMaterial,
    Camera,
    DirectionalLight,
    EnvironmentLight,
    Plane,
    Scene,
    Sphere,
    Texture,
    auto_exposure,
    display_codes,
    render,
)
from ..runtime.device import full_precision
from .figure import Drawing, Subject
from .sheet import Panel, sheet

# Copies of the texture across: both texels and structure are visible.
REPEAT = 2.0
SUN = (-1.0, 1.0, 1.5)
PLANE_CAMERA = (math.radians(50.0), math.radians(270.0))
CAPTION = (
    "Rendering comparisons. In each pair the left picture is the original BTF, interpolated "
    "between its measured directions, and the right one is the model. Both share one exposure, "
    "which maps the 99.9th percentile of the original to white."
)


def draw_comparison(subject: Subject) -> Drawing:
    """Pairs of renderings: original on the left, model on the right."""
    settings, device = subject.choices.settings(), subject.device
    materials = (BTFMaterial.build(subject.source.btf, device, subject.model.rule), subject.model)
    rows, exposures = [], {}
    scenes = scenes_of(subject.aspect)
    total = len(scenes) * len(materials) * settings.size**2 * settings.samples
    with subject.progress.stage("figure3", total, "eye rays") as stage, full_precision():
        for name, scene in scenes.items():
            pair = [render(each, scene, settings, device, progress=stage) for each in materials]
            exposure = auto_exposure([pair[0].picture], [pair[0].coverage])
            codes = [display_codes(each.picture, exposure) for each in pair]
            labels = (f"{name}: original", f"{name}: model")
            rows.append([Panel(*panel) for panel in zip(codes, labels, strict=True)])
            exposures[name] = exposure
    return Drawing(sheet(rows), CAPTION, {"exposure": exposures})


def scenes_of(aspect: float) -> dict[str, Scene]:
    """Scenes by their names; `aspect` is width over height of the texture."""
    texture = Texture(REPEAT, aspect)
    studio, sun = (EnvironmentLight.studio(),), (DirectionalLight.build(SUN),)
    return {
        "Sphere, studio light": Scene(Sphere(texture), Camera.orthographic(), studio),
        "Sphere, one light": Scene(Sphere(texture), Camera.orthographic(), sun),
        "Plane, one light": Scene(Plane(texture), Camera.perspective(*PLANE_CAMERA), sun),
    }
