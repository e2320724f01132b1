"""The shape to which shapes broadcast, without the algebra that PyTorch imports to find it."""

from __future__ import annotations

from collections.abc import Sequence

import torch


def broadcast_shape(*shapes: Sequence[int]) -> torch.Size:
    """The shape to which all shapes broadcast.

    The first call of `torch.broadcast_shapes` imports SymPy, which takes a second or two. It is
    left to programs that are compiled, whose sizes may be symbols.

    Raises:
        RuntimeError: shapes that do not broadcast.
    """
    if torch.compiler.is_compiling():
        return torch.broadcast_shapes(*shapes)
    sizes = [1] * max(map(len, shapes), default=0)
    for shape in shapes:
        for place in range(-len(shape), 0):
            if sizes[place] == 1:
                sizes[place] = shape[place]
            elif shape[place] not in (1, sizes[place]):
                return torch.broadcast_shapes(*shapes)  # which says what is wrong
    return torch.Size(sizes)
