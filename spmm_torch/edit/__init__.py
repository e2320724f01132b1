"""Edits of a model [WDR11 §5]: pure functions that return another SPMM and change none.

    where = select_texels(model, mask) & lobe_group(model, "specular")
    model = intensity(model, 1.5, where)

Every edit takes one `Selection`: which texels, which lobes, and which share of them. Tensors that
an edit does not change are shared with the original, so an edit is cheap, and so is undo. Angles
are radians in functions, degrees in scripts.
"""

from .colour import change_colours, change_table, linear_change
from .edits import EDITS
from .edits.blend import blend
from .edits.copy_look import copy_look, rearranged
from .edits.hue_saturation import hue_saturation
from .edits.intensity import intensity
from .edits.relief_depth import relief_depth
from .edits.replace_model import replace_model
from .edits.residual_strength import residual_strength
from .edits.rotate_tangent import rotate_tangent
from .edits.scale_width import scale_width
from .edits.set_parameter import set_parameter
from .edits.spread_normals import spread_normals
from .groups import GROUPS, lobe_group
from .masks import MASKS
from .masks.cluster import cluster_selection
from .masks.colour import colour_selection
from .masks.lobes import lobe_selection
from .masks.picture import picture_selection
from .masks.rectangle import Rectangle
from .masks.stripes import Stripes
from .options import Edit, Mask
from .script import Script, Step
from .selection import EVERYTHING, Selection, select_lobes, select_texels
from .widths import widths

__all__ = [
    "EDITS",
    "EVERYTHING",
    "GROUPS",
    "MASKS",
    "Edit",
    "Mask",
    "Rectangle",
    "Script",
    "Selection",
    "Step",
    "Stripes",
    "blend",
    "change_colours",
    "change_table",
    "cluster_selection",
    "colour_selection",
    "copy_look",
    "hue_saturation",
    "intensity",
    "linear_change",
    "lobe_group",
    "lobe_selection",
    "picture_selection",
    "rearranged",
    "relief_depth",
    "replace_model",
    "residual_strength",
    "rotate_tangent",
    "scale_width",
    "select_lobes",
    "select_texels",
    "set_parameter",
    "spread_normals",
    "widths",
]
