"""The registry of edits: a file and an entry in `EDITS` for each.

The file holds a frozen dataclass, whose fields are the options of the edit and whose `apply` makes
the edited model. Scripts, the help of `spmm edit` and the editor find it here by its name.
"""

from __future__ import annotations

from ..options import Edit
from .blend import Blend
from .copy_look import CopyLook
from .hue_saturation import HueSaturation
from .intensity import Intensity
from .relief_depth import ReliefDepth
from .replace_model import ReplaceModel
from .residual_strength import ResidualStrength
from .rotate_tangent import RotateTangent
from .scale_width import ScaleWidth
from .set_parameter import SetParameter
from .spread_normals import SpreadNormals

EDITS: dict[str, type[Edit]] = {
    "intensity": Intensity,
    "hue_saturation": HueSaturation,
    "scale_width": ScaleWidth,
    "spread_normals": SpreadNormals,
    "rotate_tangent": RotateTangent,
    "set_parameter": SetParameter,
    "replace_model": ReplaceModel,
    "residual_strength": ResidualStrength,
    "relief_depth": ReliefDepth,
    "blend": Blend,
    "copy_look": CopyLook,
}
