"""The mixture of lobes at a place of the texture: its value, its sampler, and its density.

Lobes are entries of the blocks of 2 x 2 texels; one loop runs over those of the block that a ray
meets [WDR11 Eq. 2, 3, 8, 9].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..lobes.sampling import LOWEST_Z
from ..model.sampling import CODE_MAX
from .arrays import loop, one, row
from .brdf import TWINS, Twin
from .brdf.base import COS_EPS
from .brdf.warp import cosine_pdf, square_to_cosine_hemisphere
from .libraries import dr, mi

# Numbers of a lobe: its frame, up to six parameters, and which of the models in use it has.
LOBE = 16
KAPPA, MODEL = 9, 15


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


def value(lobes: Lobes, entries: Entries, block: Any, weights: Sequence[Any], wi: Any, wo: Any) -> Any:
    """The sum over lobes in Eq. 2 [WDR11], RGB, of a block whose texels have bilinear weights."""
    if not entries.count:
        return mi.Color3f(0.0)
    entry, end = entries.of(block)

    def add(entry: Any, red: Any, green: Any, blue: Any, *given: Any) -> tuple[Any, ...]:
        wi, wo, weights = given[0], given[1], given[2:]
        rho = _rho(lobes, row(lobes.table, one(entries.lobe, entry), LOBE), wi, wo)
        parts = [_mixed(row(entries.numbers, 3 * entry + c, 4), weights) for c in range(3)]
        sums = (s + rho * p for s, p in zip((red, green, blue), parts, strict=True))
        return entry + 1, *sums, *given

    lit = (wi.z > 0.0) & (wo.z > 0.0)
    start = (dr.select(lit, entry, end), mi.Float(0.0), mi.Float(0.0), mi.Float(0.0))
    state = loop((*start, wi, wo, *weights), lambda entry, *_: entry < end, add)
    return mi.Color3f(*state[1:4])


def _rho(lobes: Lobes, numbers: Sequence[Any], wi: Any, wo: Any) -> Any:
    """rho_j of a lobe [WDR11 Eq. 3], of wi and wo above the horizon of the texel."""
    local_wi, local_wo = _local(numbers, wi), _local(numbers, wo)
    lit = (local_wi.z > 0.0) & (local_wo.z > 0.0)
    f = _dispatched(lobes, "eval", numbers, local_wi, local_wo)
    cosine = local_wi.z
    if lobes.lowest > 0.0:
        excess = dr.maximum(cosine - numbers[8] * wi.z, 0.0)
        cosine -= (1.0 - dr.minimum(wi.z / lobes.lowest, 1.0)) * excess
    if lobes.horizon > 0.0:
        t = dr.clip(local_wo.z / math.sin(lobes.horizon), 0.0, 1.0)
        cosine *= t * t * (3.0 - 2.0 * t)
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
        numbers = row(lobes.table, one(entries.lobe, entry), LOBE)
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


def density(lobes: Lobes, entries: Entries, block: Any, chances: Shares, wi: Any, wo: Any) -> Any:
    """Density of `sample` at wi, in 1/sr; 0 under the horizon of the texel."""
    if not entries.count:
        return cosine_pdf(wi)
    first, end = entries.of(block)

    def add(entry: Any, total: Any) -> tuple[Any, Any]:
        numbers = row(lobes.table, one(entries.lobe, entry), LOBE)
        mass = _mixed(row(entries.numbers, entry, 4), chances.corner)
        mass = dr.select(_sees(numbers, wo), mass, 0.0)
        return entry + 1, total + mass * _lobe_density(lobes, numbers, wi, wo)

    start = (dr.select(wi.z > 0.0, first, end), mi.Float(0.0))
    total = loop(start, lambda entry, total: entry < end, add)[1]
    return total + chances.cosine * cosine_pdf(wi)


def sample(
    lobes: Lobes, entries: Entries, block: Any, chances: Shares, wo: Any, u: Sequence[Any]
) -> Any:
    """wi in the upper hemisphere: of one specular lobe, or of the cosine lobe."""
    wi = square_to_cosine_hemisphere(u[1:])
    if not entries.count:
        return wi
    first, end = entries.of(block)

    def passed(entry: Any, left: Any, mass: Any, found: Any) -> tuple[Any, ...]:
        numbers = row(lobes.table, one(entries.lobe, entry), LOBE)
        mass = _mixed(row(entries.numbers, entry, 4), chances.corner)
        mass = dr.select(_sees(numbers, wo), mass, 0.0)
        found = left < mass
        return dr.select(found, entry, entry + 1), dr.select(found, left, left - mass), mass, found

    start = (first, u[0], mi.Float(1.0), mi.Bool(False))
    go_on = lambda entry, left, mass, found: (found ^ True) & (entry < end)  # noqa: E731
    entry, left, mass, found = loop(start, go_on, passed)
    share = dr.minimum(left / mass, 1.0 - 2.0**-24)
    numbers = row(lobes.table, one(entries.lobe, dr.select(found, entry, 0)), LOBE)
    drawn = _lobe_sample(lobes, numbers, wo, (share, *u[1:]))
    return dr.select(found, drawn, wi)


def _lobe_sample(lobes: Lobes, numbers: Sequence[Any], wo: Any, u: Sequence[Any]) -> Any:
    """wi drawn from a lobe; under the horizon of the texel it is mirrored upward."""
    local = _dispatched(lobes, "sample", numbers, _raised(_local(numbers, wo)), tuple(u))
    wi = mi.Vector3f(*(sum(local[k] * numbers[3 * k + c] for k in range(3)) for c in range(3)))
    return mi.Vector3f(wi.x, wi.y, dr.maximum(dr.abs(wi.z), LOWEST_Z))


def _lobe_density(lobes: Lobes, numbers: Sequence[Any], wi: Any, wo: Any) -> Any:
    """Density of `_lobe_sample` at wi above the horizon of the texel."""
    view = _raised(_local(numbers, wo))
    upper = _dispatched(lobes, "pdf", numbers, _local(numbers, wi), view)
    mirrored = _local(numbers, mi.Vector3f(wi.x, wi.y, -wi.z))
    return upper + _dispatched(lobes, "pdf", numbers, mirrored, view)


def _dispatched(lobes: Lobes, function: str, numbers: Sequence[Any], *given: Any) -> Any:
    """A function of the BRDF that a lobe has."""
    kappa = tuple(numbers[KAPPA : KAPPA + 3])
    functions = [getattr(twin, function) for twin in lobes.twins]
    if len(functions) == 1:
        return functions[0](kappa, *given)
    return dr.switch(mi.UInt32(numbers[MODEL]), functions, kappa, *given)


def _local(numbers: Sequence[Any], w: Any) -> Any:
    """A direction in the frame of a lobe."""
    return mi.Vector3f(
        *(numbers[k] * w.x + numbers[k + 1] * w.y + numbers[k + 2] * w.z for k in (0, 3, 6))
    )


def _raised(w: Any) -> Any:
    """A view in the frame of a lobe, mirrored and lifted above its horizon."""
    return dr.normalize(mi.Vector3f(w.x, w.y, dr.maximum(dr.abs(w.z), COS_EPS)))


def _sees(numbers: Sequence[Any], wo: Any) -> Any:
    """Whether wo is above the horizons of a lobe and of the texel."""
    return (numbers[6] * wo.x + numbers[7] * wo.y + numbers[8] * wo.z > 0.0) & (wo.z > 0.0)


def _mixed(numbers: Sequence[Any], weights: Sequence[Any]) -> Any:
    """The sum of four numbers with four weights."""
    return sum(n * w for n, w in zip(numbers, weights, strict=True))
