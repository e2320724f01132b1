"""The model as GLSL: one function, `reflectance`, put together of the files in `web_page/glsl`."""

from __future__ import annotations

from importlib.resources import files

import torch

from ..brdf import MODEL_NAMES
from ..errors import OutputError
from ..geometry.directions import MIRROR
from ..model.spmm import SPMM

FOLDER = files("spmm_torch.export") / "web_page" / "glsl"
# Parts before and after the BRDFs, in the order in which they name each other.
BEFORE = ("numbers", "frame", "cut", "half_vector")
AFTER = ("texture", "relief", "mixture", "measured_pairs", "residual", "value")
# Numbers of a type in one texel of 16 bytes.
NUMBERS = {torch.int8: 16, torch.float16: 8, torch.float32: 4}
FLAT, PLANE, HEIGHTS = 0, 1, 2


def reflectance_shader(model: SPMM) -> str:
    """GLSL ES 3.00 of a model, without a version line.

    It expects `LIGHTS`, `ROW` and `MAP_SIZE` to be defined before it, and textures as
    `web_page/js/textures.js` makes them.

    Raises:
        OutputError: a lobe has a BRDF without GLSL.
    """
    defines = "".join(f"#define {name} {value}\n" for name, value in _constants(model).items())
    used = [MODEL_NAMES[index] for index in torch.unique(model.lobe_model).tolist()]
    parts = [
        defines,
        *(glsl(f"{name}.glsl") for name in BEFORE),
        *(brdf(name) for name in used),
        dispatch(used),
        *(glsl(f"{name}.glsl") for name in AFTER),
    ]
    return "\n".join(parts)


def glsl(name: str) -> str:
    """The text of a file of GLSL."""
    return (FOLDER / name).read_text(encoding="utf-8")


def brdf(name: str) -> str:
    """The text of a BRDF: a function of its name of kappa, wi and wo in the frame of the lobe.

    Raises:
        OutputError: there is none.
    """
    try:
        return glsl(f"lobes/{name}.glsl")
    except FileNotFoundError:
        raise OutputError(
            f"the model has lobes of the BRDF {name}, which has no GLSL; expected "
            f"web_page/glsl/lobes/{name}.glsl in spmm_torch/export; write it, or fit without it."
        ) from None


def dispatch(used: list[str]) -> str:
    """GLSL that calls a BRDF by its place in the registry.

    Args:
        used: names of the BRDFs that are there.
    """
    cases = "".join(
        f"        case {MODEL_NAMES.index(name)}u: return {name}(kappa, wi, wo);\n" for name in used
    )
    return (
        "float brdf_value(uint brdf, vec3 kappa, vec3 wi, vec3 wo) {\n"
        f"    switch (brdf) {{\n{cases}        default: return 0.0;\n    }}\n}}\n"
    )


def _constants(model: SPMM) -> dict[str, int]:
    """What the shader has to know of a model before it is compiled."""
    components, relief = model.components, model.relief
    kind = FLAT
    if relief is not None:
        kind = PLANE if relief.encoded()[0] is None else HEIGHTS
    constants = {
        "MIRROR": int(model.rule == MIRROR),
        "RELIEF": kind,
        "CLUSTERS": int(len(model.residual.code) > 0),
        "RANK": 0 if components is None else components.rank,
    }
    if components is not None:
        constants["FUNCTION_NUMBERS"] = NUMBERS[components.code.dtype]
        constants["COEFFICIENT_NUMBERS"] = NUMBERS[components.coefficient.dtype]
    return constants
