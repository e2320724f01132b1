"""A picture by Blender's Cycles of the OSL export: `python -m tests.benchmarks.cycles_picture RUN`.

Needs `bpy`, Blender as a module of Python (`pip install bpy`, for one version of Python, 370 MB). A
plane of one texture under a sun, seen slantwise by parallel rays: the relative error of Cycles'
picture against the closures as `spmm export` measures them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.export.osl import write
from spmm_torch.export.target import NoSettings
from spmm_torch.runtime.progress import Progress
from tests.slant_view import (
    DISTANCE,
    SIZE,
    WIDTH,
    add_model,
    light_and_view,
    model_of,
    seen,
    told,
)

SAMPLES = 16
# Width of the filter of a pixel: a point.
POINT = 0.01


def closure_nodes(tree: Any, folder: Path) -> None:
    """The nodes that howto.md tells to add."""
    cycles = import_module("cycles.osl")
    script = tree.nodes.new("ShaderNodeScript")
    script.mode, script.filepath = "EXTERNAL", str(folder / "spmm.osl")
    cycles.update_script_node(script, lambda *told: print(*told))
    script.inputs["folder"].default_value = str(folder)
    place, tangent = tree.nodes.new("ShaderNodeUVMap"), tree.nodes.new("ShaderNodeTangent")
    tangent.direction_type = "UV_MAP"
    place.uv_map = tangent.uv_map = "map"
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(place.outputs[0], script.inputs["UV"])
    tree.links.new(tangent.outputs[0], script.inputs["Tangent"])
    tree.links.new(script.outputs[0], output.inputs[0])


def plane(bpy: Any, folder: Path) -> Any:
    """A square of side 1 with the shader."""
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(*corner, 0.0) for corner in corners], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="map")
    for number, corner in enumerate(corners):
        layer.data[number].uv = corner
    material = bpy.data.materials.new("spmm")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    material.cycles.use_bump_map_correction = False
    closure_nodes(material.node_tree, folder)
    mesh.materials.append(material)
    return bpy.data.objects.new("plane", mesh)


def settings(scene: Any, path: Path) -> None:
    """Cycles on the CPU with Open Shading Language, no bounce, one point a pixel."""
    scene.render.engine = "CYCLES"
    cycles, render = scene.cycles, scene.render
    cycles.device, cycles.shading_system = "CPU", True
    cycles.samples, cycles.max_bounces = SAMPLES, 0
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.filter_width = POINT
    render.resolution_x = render.resolution_y = SIZE
    render.resolution_percentage = 100
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(path)


def picture(folder: Path, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """(the picture `[S, S, 3]` by Cycles, uv `[S, S, 2]` of its pixels)."""
    bpy, mathutils = import_module("bpy"), import_module("mathutils")
    for packages in Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/*/site-packages"):
        sys.path.insert(0, str(packages))  # Cycles imports its reader of shaders from there
    import_module("OpenImageIO")  # whose types that reader gives
    bpy.ops.wm.read_factory_settings(use_empty=True)
    import_module("addon_utils").enable("cycles")
    scene, path = bpy.context.scene, folder / "cycles.exr"
    settings(scene, path)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle = 1.0, 0.0
    sun.rotation_euler = mathutils.Vector(wi.tolist()).to_track_quat("Z", "Y").to_euler()
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", WIDTH
    view = mathutils.Vector(wo.tolist())
    camera.location = mathutils.Vector((0.5, 0.5, 0.0)) + DISTANCE * view
    camera.rotation_euler = view.to_track_quat("Z", "Y").to_euler()
    for part in (plane(bpy, folder), sun, camera):
        scene.collection.objects.link(part)
    scene.camera = camera
    bpy.context.view_layer.update()
    uv = seen(torch.tensor([list(row) for row in camera.matrix_world]), wo)
    bpy.ops.render.render(write_still=True)
    channels = OpenEXR.File(str(path)).channels()
    name = next(name for name in channels if name.startswith("RGB"))
    return torch.from_numpy(np.array(channels[name].pixels[..., :3])), uv


@torch.no_grad()
def both_pictures(model: SPMM, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """(the picture by Cycles, what the closures of the export say), `[S, S, 3]` each."""
    with tempfile.TemporaryDirectory() as folder:
        exported = write(Path(folder), model, NoSettings(), Progress(enabled=False))
        found, uv = picture(Path(folder), wi, wo)
        return found, exported.material(uv, wi, wo)


def main() -> None:
    """Prints the error."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_model(parser)
    model = model_of(parser.parse_args())
    print(told("Cycles against its closures", *both_pictures(model, *light_and_view())))


if __name__ == "__main__":
    main()
