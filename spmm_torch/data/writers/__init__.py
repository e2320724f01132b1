"""Writers of BTFs, one module for each format.

A writer takes `(path, btf, ..., progress=None)`, asks the BTF for one view at a time, and leaves
at `path` all of it or nothing: it writes under a temporary name and renames at the end.
"""

from __future__ import annotations

from .exr import write_exr_folder
from .npz import write_npz
from .ubo2003 import write_ubo2003

__all__ = ["write_exr_folder", "write_npz", "write_ubo2003"]
