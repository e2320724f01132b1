"""An exact percentile of more values than fit into memory."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor

# Values whose maximum is taken first: few runs reach a high percentile, the others end there.
RUN = 1024


def percentile(chunks: Iterable[Tensor], count: int, fraction: float) -> float:
    """Smallest value that at least `fraction` of all values do not exceed (nearest rank).

    One pass. Holds the largest values met so far, so it is meant for fractions near 1.

    Args:
        chunks: all values, float32; negative ones count as zero.
        count: how many they are.
        fraction: in (0, 1].
    """
    kept = count - max(math.ceil(fraction * count), 1) + 1  # the last of so many largest values
    largest, bound = torch.empty(0), -math.inf
    for chunk in chunks:
        largest = torch.cat((largest, _above(chunk.flatten(), bound)))
        if len(largest) > 2 * kept:
            largest = largest.topk(kept, sorted=False).values
            bound = float(largest.min())
    return max(float(largest.topk(kept, sorted=False).values.min()), 0.0)


def _above(values: Tensor, bound: float) -> Tensor:
    """Those of `values [N]` that exceed a bound."""
    whole = len(values) // RUN * RUN
    runs = values[:whole].view(-1, RUN)
    tall = runs[runs.amax(1) > bound].flatten()
    rest = values[whole:]
    return torch.cat((tall[tall > bound], rest[rest > bound]))
