"""BTF data: one lazy texel-major `BTF`, its readers and its writers.

Names are imported when they are first asked for, so that options and formats may be listed
without importing torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .btf import BTF
    from .options import ReadOptions
    from .readers import READERS, load_btf, sample_path
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
    "sample_path",
    "select_part",
    "write_npz",
]

MODULES = {
    "BTF": ".btf",
    "READERS": ".readers",
    "Progress": ".store",
    "ReadOptions": ".options",
    "Selection": ".selection",
    "load_btf": ".readers",
    "sample_path": ".readers",
    "select_part": ".selection",
    "write_npz": ".writers.npz",
}


def __getattr__(name: str) -> Any:
    if name not in MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(import_module(MODULES[name], __name__), name))
