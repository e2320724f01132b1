"""A folder that Mitsuba 3 renders as it is: the model, a scene that names it, and its loader."""

from __future__ import annotations

from pathlib import Path

from ..mitsuba.evaluation import PluginMaterial, plugin_variant
from ..model.spmm import SPMM
from ..runtime.atomic import write_atomic
from ..runtime.progress import Progress
from ..runtime.tensor_file import MODEL_FILE
from .target import Exported, NoSettings

SCENE_FILE, LOADER = "scene.xml", "render.py"
# Copies of the texture around the sphere: squares of texels, about as large as on the spheres of
# `spmm evaluate`.
TEXELS_AROUND = 512
UNMEASURED = (
    "how Mitsuba evaluates it: Mitsuba is missing or finds no LLVM, so the file was read back"
)

SCENE = """\
<!-- {name}: a model of spmm_torch on a sphere. Render it by python render.py. -->
<scene version="3.0.0">
    <default name="size" value="512"/>
    <default name="samples" value="64"/>
    <integrator type="path">
        <integer name="max_depth" value="4"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="30"/>
        <transform name="to_world">
            <lookat origin="0, 0, 4.2" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$size"/>
            <integer name="height" value="$size"/>
        </film>
        <sampler type="independent">
            <integer name="sample_count" value="$samples"/>
        </sampler>
    </sensor>
    <shape type="sphere">
        <transform name="to_world">
            <rotate x="1" angle="-90"/>
        </transform>
        <bsdf type="spmm">
            <string name="filename" value="{model}"/>
            <transform name="to_uv">
                <scale x="{across:g}" y="{along:g}"/>
            </transform>
        </bsdf>
    </shape>
    <emitter type="constant">
        <rgb name="radiance" value="0.3"/>
    </emitter>
    <emitter type="directional">
        <vector name="direction" x="-1" y="-1" z="-1"/>
        <rgb name="irradiance" value="2.5"/>
    </emitter>
</scene>
"""

SCRIPT = """\
\"\"\"Renders scene.xml beside this file: python render.py [variant] [name=value ...].\"\"\"

import sys
from pathlib import Path

import mitsuba as mi

variants = [word for word in sys.argv[1:] if "=" not in word]
mi.set_variant(*(variants or ["llvm_ad_rgb"]))
import spmm_torch.mitsuba

spmm_torch.mitsuba.register()  # makes <bsdf type="spmm"> known
here = Path(__file__).resolve().parent
given = dict(word.split("=", 1) for word in sys.argv[1:] if "=" in word)
picture = mi.render(mi.load_file(str(here / "scene.xml"), **given))
mi.util.write_bitmap(str(here / "picture.exr"), picture)
mi.util.write_bitmap(str(here / "picture.png"), picture)
"""


def write(place: Path, model: SPMM, settings: NoSettings, progress: Progress) -> Exported:
    """Writes scene, loader and model, and evaluates them by the plug-in; see `Target.write`."""
    write_atomic(place / MODEL_FILE, model.pack())  # errors name the export, not what is in it
    (place / SCENE_FILE).write_text(scene_of(model), encoding="utf-8")
    (place / LOADER).write_text(SCRIPT, encoding="utf-8")
    variant = plugin_variant()
    if variant is None:
        return Exported(SPMM.load(place, model.weight.device), (UNMEASURED,))
    return Exported(PluginMaterial(place / MODEL_FILE, variant))


def scene_of(model: SPMM) -> str:
    """The scene of a model; its texture takes the sphere a whole number of times."""
    across = max(1, round(TEXELS_AROUND / model.width))
    along = max(1, round(across * model.width / (2 * model.height)))
    name = "".join(letter for letter in model.name if letter not in "<>&-") or "a material"
    return SCENE.format(name=name, model=MODEL_FILE, across=across, along=along)
