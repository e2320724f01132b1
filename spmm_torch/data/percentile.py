"""The exact percentile of more values than memory holds."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor

# Values of a run, which is skipped if its maximum is too low: few runs reach a high percentile.
RUN = 1024


def percentile(chunks: Iterable[Tensor], count: int, fraction: float) -> float:
    """The smallest value that at least a fraction of all values do not exceed (nearest rank).

    One pass, which holds the largest values so far: meant for fractions near 1.

    Args:
        chunks: all values, in chunks `[...]` float32; a negative percentile counts as zero.
        count: number of all values.
        fraction: fraction in (0, 1].
    """
    kept = count - max(math.ceil(fraction * count), 1) + 1  # the smallest of so many largest values
    largest, bound = torch.empty(0), -math.inf
    for chunk in chunks:
        largest = torch.cat((largest, _above(chunk.flatten(), bound)))
        if len(largest) > 2 * kept:
            largest = largest.topk(kept, sorted=False).values
            bound = float(largest.min())
    return max(float(largest.topk(kept, sorted=False).values.min()), 0.0)


def _above(values: Tensor, bound: float) -> Tensor:
    """Those of `values [N]` that exceed a bound, `[n]`."""
    whole = len(values) // RUN * RUN
    runs = values[:whole].view(-1, RUN)
    tall = runs[runs.amax(1) > bound].flatten()
    rest = values[whole:]
    return torch.cat((tall[tall > bound], rest[rest > bound]))
