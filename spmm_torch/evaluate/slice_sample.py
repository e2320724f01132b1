"""A fixed sample of direction pairs that stands for all, the same for each model of a BTF.

On path-traced materials of 81 x 81 directions, the mean PSNR of the sample is within 0.2 dB of that
of all 6,561 slices, and shares of gradients are within 0.02.
"""

from __future__ import annotations

import math

from torch import Tensor

from ..data import BTF

SLICES, LIGHTS_ABOVE = 48, 9
# Its multiples, modulo 1, fill an interval evenly, however many they are.
GOLDEN_SECTION = (math.sqrt(5.0) - 1.0) / 2.0

SlicePair = tuple[int, int]  # view and light


def spread_pairs(btf: BTF, count: int = SLICES) -> list[SlicePair]:
    """At most `count` measured pairs (view, light), spread over views and lights by their height.

    Views are taken at even steps from the highest to the lowest one, each with the light at the
    next step of the golden section: a lattice that leaves no ring of views or lights out.
    """
    if btf.measured_count <= count:
        return [(view, light) for view in _by_height(btf.view) for light in _lights_of(btf, view)]
    views = _by_height(btf.view)
    pairs = []
    for index in range(count):
        place = index + 0.5
        view = views[int(place * len(views) / count)]
        if lights := _lights_of(btf, view):
            pairs.append((view, lights[int(place * GOLDEN_SECTION % 1.0 * len(lights))]))
    return list(dict.fromkeys(pairs))


def pairs_from_above(btf: BTF, count: int = LIGHTS_ABOVE) -> list[SlicePair]:
    """The highest view that was measured, under `count` of its lights, evenly by their height."""
    view = next(view for view in _by_height(btf.view) if _lights_of(btf, view))
    lights = _lights_of(btf, view)
    count = min(count, len(lights))
    return [(view, lights[int((index + 0.5) * len(lights) / count)]) for index in range(count)]


def _by_height(directions: Tensor) -> list[int]:
    """Indices of directions `[N, 3]`, the nearest to the normal first."""
    return directions[:, 2].cpu().argsort(descending=True, stable=True).tolist()


def _lights_of(btf: BTF, view: int) -> list[int]:
    """Lights that were measured under a view, the highest first."""
    missing = None if btf.missing is None else btf.missing[view]
    return [light for light in _by_height(btf.light) if missing is None or not missing[light]]
