"""How often a tensor was changed, so that what is made of it is kept as long as it stays."""

from __future__ import annotations

from torch import Tensor


def changes(tensor: Tensor) -> int:
    """How often a tensor `[...]` was changed in place; 0 of inference mode, which counts none."""
    return 0 if tensor.is_inference() else tensor._version
