"""The registry of masks: a file and an entry in `MASKS` for each kind.

The file holds a frozen dataclass, whose fields are the options of the mask and whose `select`
makes a `Selection` of it in a model. Scripts and the help of `spmm edit` find it here by its name.
"""

from __future__ import annotations

from ..options import Mask
from .cluster import ClusterMask
from .colour import ColourMask
from .lobes import LobesMask
from .picture import PictureMask
from .rectangle import Rectangle
from .stripes import Stripes

MASKS: dict[str, type[Mask]] = {
    "rectangle": Rectangle,
    "stripes": Stripes,
    "picture": PictureMask,
    "cluster": ClusterMask,
    "colour": ColourMask,
    "lobes": LobesMask,
}
