"""The mixture of lobes at a place of the texture: its value, its sampler, and its density.

Lobes are entries of the blocks of 2 x 2 texels; one loop runs over those of the block that a ray
meets [WDR11 Eq. 2, 3, 8, 9].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..brdf import MAX_PARAMETERS
from ..lobes.sampling import LOWEST_Z
from ..model.sampling import CODE_MAX
from .arrays import branch, columns, loop, one, row
from .brdf import Twin
from .brdf.base import COS_EPS
from .brdf.warp import cosine_pdf, square_to_cosine_hemisphere
from .libraries import dr, mi

# Numbers of a lobe: its frame, up to six parameters, and which of the models in use it has.
LOBE = 16
KAPPA, MODEL = 9, 15
# Those that evaluation needs, and those of the normal.
NUMBERS = (*range(KAPPA + MAX_PARAMETERS), MODEL)
NORMAL = (6, 7, 8)


# Numbers of one lobe by their column.
Numbers = Mapping[int, Any]


@dataclass(frozen=True)
class Lobes:
    """The lobes of a model.

    Attributes:
        table: `[J, LOBE]`.
        twins: the models in use.
        horizon: angle over its own horizon within which a lobe fades for views, in radians.
        lowest: z of the lowest measured light; 0 lets none fade.
    """

    table: Any
    twins: tuple[Twin, ...]
    horizon: float
    lowest: float


@dataclass(frozen=True)
class Entries:
    """Lobes of the blocks, each once.

    Attributes:
        start: first entry of each block, `[T + 1]`.
        lobe: lobe of each entry, `[M]`.
        numbers: what each entry has for the four texels, `[M, 4]` or `[M, C, 4]`.
        count: M; where it is 0, nothing is read.
    """

    start: Any
    lobe: Any
    numbers: Any
    count: int

    def of(self, block: Any) -> tuple[Any, Any]:
        """(first entry of a block, the one after its last)."""
        return one(self.start, block), one(self.start, block + 1)


def values(
    lobes: Lobes,
    entries: Entries,
    block: Any,
    weights: Sequence[Any],
    lights: Sequence[Any],
    wo: Any,
) -> list[Any]:
    """The sum over lobes in Eq. 2 [WDR11], RGB, of a block whose texels have bilinear weights.

    Args:
        lobes, entries: of the model.
        block, weights: the place.
        lights: one or more wi, which share what is read.
        wo: view.
    """
    if not entries.count:
        return [mi.Color3f(0.0) for _ in lights]
    entry, end = entries.of(block)
    sums = 3 * len(lights)

    def add(entry: Any, *state: Any) -> tuple[Any, ...]:
        total, given = state[:sums], state[sums:]
        wo, lights, weights = given[0], given[1:-4], given[-4:]
        numbers = columns(lobes.table, one(entries.lobe, entry), LOBE, NUMBERS)
        texels = columns(entries.numbers, entry, 12, range(12))
        mixed = [_mixed([texels[4 * c + k] for k in range(4)], weights) for c in range(3)]
        local_wo = _local(numbers, wo)
        rho = [_rho(lobes, numbers, wi, local_wo) for wi in lights]
        parts = (r * m for r in rho for m in mixed)
        return entry + 1, *(t + p for t, p in zip(total, parts, strict=True)), *given

    lit = (wo.z > 0.0) & _any([wi.z > 0.0 for wi in lights])
    zeros = (mi.Float(0.0) for _ in range(sums))
    start = (dr.select(lit, entry, end), *zeros, wo, *lights, *weights)
    state = loop(start, lambda entry, *_: entry < end, add)[1 : 1 + sums]
    colours = (mi.Color3f(*state[3 * n : 3 * n + 3]) for n in range(len(lights)))
    return [
        dr.select((wi.z > 0.0) & (wo.z > 0.0), colour, 0.0)
        for wi, colour in zip(lights, colours, strict=True)
    ]


def _rho(lobes: Lobes, numbers: Numbers, wi: Any, local_wo: Any) -> Any:
    """rho_j of a lobe [WDR11 Eq. 3], of wi and wo above the horizon of the texel."""
    local_wi = _local(numbers, wi)
    lit = (local_wi.z > 0.0) & (local_wo.z > 0.0)
    f = _dispatched(lobes, "eval", numbers, local_wi, local_wo)
    cosine = local_wi.z
    if lobes.lowest > 0.0:
        excess = dr.maximum(cosine - numbers[8] * wi.z, 0.0)
        cosine = cosine - (1.0 - dr.minimum(wi.z / lobes.lowest, 1.0)) * excess
    if lobes.horizon > 0.0:
        t = dr.clip(local_wo.z / math.sin(lobes.horizon), 0.0, 1.0)
        cosine = cosine * (t * t * (3.0 - 2.0 * t))
    return dr.select(lit, f * cosine, 0.0)


@dataclass(frozen=True)
class Shares:
    """Probabilities of a place and a view.

    Attributes:
        corner: what a code of a specular entry counts for each of the four texels.
        cosine: probability of the cosine lobe.
    """

    corner: tuple[Any, ...]
    cosine: Any


def shares(
    lobes: Lobes, entries: Entries, group: Any, block: Any, weights: Sequence[Any], wo: Any
) -> Shares:
    """The probabilities of specular entries [WDR11 Eq. 9] that see the view wo.

    Args:
        lobes: of the model.
        entries: specular ones with their codes, `[M, 4]`.
        group: codes of the specular group of the texels of each block, `[T, 4]`.
        block, weights: the place.
        wo: view.
    """
    if not entries.count:
        return Shares((), 1.0)
    first, end = entries.of(block)

    def add(entry: Any, *totals: Any) -> tuple[Any, ...]:
        numbers = columns(lobes.table, one(entries.lobe, entry), LOBE, NORMAL)
        codes = row(entries.numbers, entry, 4)
        seen = _sees(numbers, wo)
        return entry + 1, *(t + dr.select(seen, c, 0.0) for t, c in zip(totals, codes, strict=True))

    start = (first, *(mi.Float(0.0) for _ in range(4)))
    totals = loop(start, lambda entry, *_: entry < end, add)[1:]
    masses = [
        dr.select(total > 0.0, weight * code * (1.0 / CODE_MAX), 0.0)
        for total, weight, code in zip(totals, weights, row(group, block, 4), strict=True)
    ]
    corner = tuple(m / dr.maximum(t, 1.0) for m, t in zip(masses, totals, strict=True))
    return Shares(corner, 1.0 - (masses[0] + masses[1] + masses[2] + masses[3]))


def densities(
    lobes: Lobes, entries: Entries, block: Any, chances: Shares, lights: Sequence[Any], wo: Any
) -> list[Any]:
    """Density of `sample` at each wi of `lights`, in 1/sr; 0 under the horizon of the texel."""
    if not entries.count:
        return [cosine_pdf(wi) for wi in lights]
    first, end = entries.of(block)

    def add(entry: Any, *total: Any) -> tuple[Any, ...]:
        numbers = columns(lobes.table, one(entries.lobe, entry), LOBE, NUMBERS)
        mass = _mixed(row(entries.numbers, entry, 4), chances.corner)
        mass = dr.select(_sees(numbers, wo), mass, 0.0)
        view = _raised(_local(numbers, wo))
        found = (_lobe_density(lobes, numbers, wi, view) for wi in lights)
        return entry + 1, *(t + mass * f for t, f in zip(total, found, strict=True))

    lit = _any([wi.z > 0.0 for wi in lights])
    start = (dr.select(lit, first, end), *(mi.Float(0.0) for _ in lights))
    totals = loop(start, lambda entry, *_: entry < end, add)[1:]
    return [
        dr.select(wi.z > 0.0, total + chances.cosine * cosine_pdf(wi), 0.0)
        for wi, total in zip(lights, totals, strict=True)
    ]


def sample(
    lobes: Lobes, entries: Entries, block: Any, chances: Shares, wo: Any, u: Sequence[Any]
) -> Any:
    """wi in the upper hemisphere: of one specular lobe, or of the cosine lobe."""
    wi = square_to_cosine_hemisphere(u[1:])
    if not entries.count:
        return wi
    first, end = entries.of(block)

    def passed(entry: Any, left: Any, mass: Any, found: Any) -> tuple[Any, ...]:
        numbers = columns(lobes.table, one(entries.lobe, entry), LOBE, NORMAL)
        mass = _mixed(row(entries.numbers, entry, 4), chances.corner)
        mass = dr.select(_sees(numbers, wo), mass, 0.0)
        found = left < mass
        return dr.select(found, entry, entry + 1), dr.select(found, left, left - mass), mass, found

    start = (first, u[0], mi.Float(1.0), mi.Bool(False))
    go_on = lambda entry, left, mass, found: (found ^ True) & (entry < end)  # noqa: E731
    entry, left, mass, found = loop(start, go_on, passed)
    share = dr.minimum(left / mass, 1.0 - 2.0**-24)
    chosen = one(entries.lobe, dr.select(found, entry, 0))
    numbers = columns(lobes.table, chosen, LOBE, NUMBERS)
    drawn = _lobe_sample(lobes, numbers, wo, (share, *u[1:]))
    return dr.select(found, drawn, wi)


def _lobe_sample(lobes: Lobes, numbers: Numbers, wo: Any, u: Sequence[Any]) -> Any:
    """wi drawn from a lobe; under the horizon of the texel it is mirrored upward."""
    local = _dispatched(lobes, "sample", numbers, _raised(_local(numbers, wo)), tuple(u))
    wi = mi.Vector3f(*(sum(local[k] * numbers[3 * k + c] for k in range(3)) for c in range(3)))
    return mi.Vector3f(wi.x, wi.y, dr.maximum(dr.abs(wi.z), LOWEST_Z))


def _lobe_density(lobes: Lobes, numbers: Numbers, wi: Any, view: Any) -> Any:
    """Density of `_lobe_sample` at wi above the horizon of the texel, of a raised view."""
    upper = _dispatched(lobes, "pdf", numbers, _local(numbers, wi), view)
    mirrored = _local(numbers, mi.Vector3f(wi.x, wi.y, -wi.z))
    return upper + _dispatched(lobes, "pdf", numbers, mirrored, view)


def _dispatched(lobes: Lobes, function: str, numbers: Numbers, *given: Any) -> Any:
    """A function of the BRDF that a lobe has.

    Branches, of which rays of one lobe take one, are faster than calls by `drjit.switch`.
    """
    kappa = tuple(numbers[KAPPA + n] for n in range(MAX_PARAMETERS))
    functions = [getattr(twin, function) for twin in lobes.twins]
    if len(functions) == 1:
        return functions[0](kappa, *given)
    found = mi.Vector3f(0.0) if function == "sample" else mi.Float(0.0)
    model = mi.UInt32(numbers[MODEL])
    for number, chosen in enumerate(functions):
        found = branch(model == number, chosen, found, kappa, *given)
    return found


def _local(numbers: Numbers, w: Any) -> Any:
    """A direction in the frame of a lobe."""
    return mi.Vector3f(
        *(numbers[k] * w.x + numbers[k + 1] * w.y + numbers[k + 2] * w.z for k in (0, 3, 6))
    )


def _raised(w: Any) -> Any:
    """A view in the frame of a lobe, mirrored and lifted above its horizon."""
    return dr.normalize(mi.Vector3f(w.x, w.y, dr.maximum(dr.abs(w.z), COS_EPS)))


def _sees(numbers: Numbers, wo: Any) -> Any:
    """Whether wo is above the horizons of a lobe and of the texel."""
    return (numbers[6] * wo.x + numbers[7] * wo.y + numbers[8] * wo.z > 0.0) & (wo.z > 0.0)


def _mixed(numbers: Sequence[Any], weights: Sequence[Any]) -> Any:
    """The sum of four numbers with four weights."""
    return sum(n * w for n, w in zip(numbers, weights, strict=True))


def _any(masks: Sequence[Any]) -> Any:
    """Whether one of some conditions holds."""
    found = masks[0]
    for mask in masks[1:]:
        found = found | mask
    return found
