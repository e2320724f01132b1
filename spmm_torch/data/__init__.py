"""BTF data: one lazy texel-major `BTF`, its readers and its writers.

Names are imported at first use, so that options and formats can be listed without torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..runtime.lazy import lazy_names

if TYPE_CHECKING:
    from .btf import BTF
    from .options import ReadOptions
    from .readers import READERS, load_btf, load_input, obeying, sample_path
    from .selection import Selection, select_part
    from .store import Progress
    from .writers.npz import write_npz

__all__ = [
    "BTF",
    "READERS",
    "Progress",
    "ReadOptions",
    "Selection",
    "load_btf",
    "load_input",
    "obeying",
    "sample_path",
    "select_part",
    "write_npz",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "BTF": ".btf",
        "READERS": ".readers",
        "Progress": ".store",
        "ReadOptions": ".options",
        "Selection": ".selection",
        "load_btf": ".readers",
        "load_input": ".readers",
        "obeying": ".readers",
        "sample_path": ".readers",
        "select_part": ".selection",
        "write_npz": ".writers.npz",
    },
)
