"""Edits of a model [WDR11 §5]: pure functions that return another SPMM and change none.

    where = select_texels(model, mask)
    model = intensity(model, 1.5, where & lobe_selection(model, specular=True))

Tensors that an edit does not change are shared with the original, so edits are cheap and keeping
all of them for undo is too. Angles are radians.
"""

from .colour import change_colours, change_table, linear_change
from .edit_options import EDITS
from .groups import GROUPS, lobe_group
from .mask_options import MASKS
from .masks import cluster_selection, colour_selection, lobe_selection, picture_selection
from .mixing import blend, copy_look, rearranged
from .normals import rotate_tangent, spread_normals
from .parameters import replace_model, set_parameter
from .recolour import hue_saturation
from .regions import Rectangle, Stripes
from .residual import residual_strength
from .script import Script, Step
from .selection import Selection, select_lobes, select_texels
from .weights import intensity
from .widths import scale_width, widths

__all__ = [
    "EDITS",
    "GROUPS",
    "MASKS",
    "Rectangle",
    "Selection",
    "Script",
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
