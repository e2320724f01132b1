"""Pictures of a material on a sphere or a plane, by direct light: `spmm render`, and in Python

    scene = Scene(Sphere(Texture(repeat=2.0)), Camera.orthographic(), (EnvironmentLight.studio(),))
    picture = render(model, scene, RenderSettings(size=256, samples=4)).picture

A material is an `SPMM`, a `BTFMaterial` (the BTF itself, interpolated), or any other function of
(uv, wi, wo) to cosine-weighted RGB. One with `sample` and `pdf` is sampled by them.
"""

from ..config.render import RenderSettings
from .btf_material import BTFMaterial
from .camera import Camera, turn
from .display import auto_exposure, display_codes, encode_display, write_exr, write_gif, write_png
from .environment import EnvironmentLight
from .lights import DirectionalLight, PointLight
from .material import CosineSampled, Material, SampledMaterial
from .renderer import Light, Rendering, Scene, render
from .shapes import Plane, Sphere, Texture

__all__ = [
    "BTFMaterial",
    "Camera",
    "CosineSampled",
    "DirectionalLight",
    "EnvironmentLight",
    "Light",
    "Material",
    "Plane",
    "PointLight",
    "RenderSettings",
    "Rendering",
    "SampledMaterial",
    "Scene",
    "Sphere",
    "Texture",
    "auto_exposure",
    "display_codes",
    "encode_display",
    "render",
    "turn",
    "write_exr",
    "write_gif",
    "write_png",
]
