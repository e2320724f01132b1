"""The mixture of lobes at a place of the texture: its value, its sampler, and its density.

Lobes are entries of the blocks of 2 x 2 texels, those of one BRDF together. A loop for each BRDF
runs over the entries of the block that a ray meets [WDR11 Eq. 2, 3, 8, 9]: loops without branches
are faster than one loop that chooses. Each gives values and densities, which share what is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..model.sampling import CODE_MAX
from .arrays import loop, one, power_of_two, row
from .brdf import Twin
from .brdf.warp import cosine_pdf, square_to_cosine_hemisphere
from .libraries import dr, mi
from .lobe import Lobe, Lobes, density, raised

# Channels of a row of weights: RGB and one that is not used, so that a row is read at once.
CHANNELS = 4
# A block of texels, and their weights.
Place = tuple[Any, Sequence[Any]]


@dataclass(frozen=True)
class Entries:
    """Lobes of the blocks, each once.

    Attributes:
        ends: first entry of each group in each block, and the one after the last of all, `[T, n]`
            with n a power of two, the numbers beyond unused.
        groups: numbers of the groups that some block has. Groups are the BRDFs in use, first the
            entries that are not sampled and then those that are; or one, of all that are.
        links: lobe of each entry, and codes of its probability in the four texels, a byte each,
            `[M, 2]`.
    """

    ends: Any
    groups: tuple[int, ...]
    links: Any

    def of(self, block: Any) -> list[tuple[int, Any, Any]]:
        """(number, first entry, the one after the last) of each group in a block."""
        if not self.groups:
            return []
        count = len(self.groups) + 1
        ends = row(self.ends, block, power_of_two(count))[:count]
        return list(zip(self.groups, ends, ends[1:], strict=False))


@dataclass(frozen=True)
class Shares:
    """Probabilities of a place and a view.

    Attributes:
        corner: what a code of a specular entry counts for each of the four texels; none if no
            texel has such an entry.
        cosine: probability of the cosine lobe.
    """

    corner: tuple[Any, ...]
    cosine: Any


def evaluated(
    lobes: Lobes,
    entries: Entries,
    numbers: Any,
    place: Place,
    chances: Shares,
    wi: Any,
    wo: Any,
) -> tuple[Any, Any]:
    """(the sum over lobes in Eq. 2 [WDR11], RGB; the density of `sample` in 1/sr) at wi.

    Both are 0 where wi or wo is under the horizon of the texel.

    Args:
        lobes, entries: of the model, by BRDF.
        numbers: weights of the entries, `[M, CHANNELS, n]`.
        place: a block, and the weights of its texels.
        chances: of `sample` at this place.
        wi: light.
        wo: view.
    """
    totals = tuple(mi.Float(0.0) for _ in range(4))
    (block, weights), corner = place, chances.corner
    for group in entries.of(block):
        totals = _with_group(lobes, entries.links, numbers, group, totals, weights, corner, wi, wo)
    above = (wi.z > 0.0) & (wo.z > 0.0)
    density = dr.select(above, totals[3] + chances.cosine * cosine_pdf(dr.detach(wi)), 0.0)
    return dr.select(above, mi.Color3f(*totals[:3]), 0.0), density


def _with_group(
    lobes: Lobes,
    links: Any,
    numbers: Any,
    group: tuple[int, Any, Any],
    totals: tuple[Any, ...],
    weights: Sequence[Any],
    corner: tuple[Any, ...],
    wi: Any,
    wo: Any,
) -> tuple[Any, ...]:
    """`totals`, RGB and density, with the entries of a group; see `evaluated`.

    All that has gradients is part of the state of the loop, and sums are added after it: no loop
    may add to what has gradients before it.
    """
    number, entry, end = group
    twin, sampled = lobes.twins[number // 2], bool(corner) and number % 2 == 1

    def add(entry: Any, *state: Any) -> tuple[Any, ...]:
        total, wi, wo, weights = state[:4], state[4], state[5], state[6:]
        index, codes = row(links, entry, 2)
        lobe = lobes.of(index)
        light, view = lobe.local(wi), lobe.local(wo)
        rho = lobes.rho(twin, lobe, wi, light, view)
        parts = [rho * alpha for alpha in _channels(numbers, entry, weights)]
        mass = 0.0
        if sampled:
            mass = _density(twin, lobe, codes, corner, wi, light, wo, view)
        more = (t + part for t, part in zip(total, (*parts, mass), strict=True))
        return entry + 1, *more, wi, wo, *weights

    lit = (wo.z > 0.0) & (wi.z > 0.0)
    apart = dr.grad_enabled(totals)
    before = tuple(mi.Float(0.0) for _ in totals) if apart else totals
    start = (dr.select(lit, entry, end), *before, wi, wo, *weights)
    after = loop(start, lambda entry, *_: entry < end, add)[1:5]
    return tuple(t + part for t, part in zip(totals, after, strict=True)) if apart else after


def _density(
    twin: Twin,
    lobe: Lobe,
    codes: Any,
    corner: Sequence[Any],
    wi: Any,
    light: Any,
    wo: Any,
    view: Any,
) -> Any:
    """What a lobe adds to the density of wi: local `light` and `view` of `wi` and `wo`."""
    lobe, view = lobe.detached(), raised(dr.detach(view))
    seen = dr.select(dr.dot(lobe.normal, dr.detach(wo)) > 0.0, codes, 0)
    mass = _mixed(_bytes(seen, len(corner)), corner)
    return mass * density(twin, lobe, dr.detach(wi), dr.detach(light), view)


def shares(lobes: Lobes, entries: Entries, group: Any, place: Place, wo: Any) -> Shares:
    """The probabilities of specular entries [WDR11 Eq. 9] that see the view wo.

    Args:
        lobes: of the model.
        entries: specular ones.
        group: codes of the specular group of the texels of each block, a byte each, `[T]`.
        place: a block, and the bilinear weights of its texels.
        wo: view.
    """
    if not entries.groups:
        return Shares((), mi.Float(1.0))
    block, weights = place
    ((_, entry, end),) = entries.of(block)

    def add(entry: Any, *totals: Any) -> tuple[Any, ...]:
        codes = _seen_codes(lobes, entries, entry, wo, len(weights))
        return entry + 1, *(t + code for t, code in zip(totals, codes, strict=True))

    start = (entry, *(mi.Float(0.0) for _ in weights))
    totals = loop(start, lambda entry, *_: entry < end, add)[1:]
    groups = _bytes(one(group, block), len(weights))
    masses = [
        dr.select(total > 0.0, weight * code * (1.0 / CODE_MAX), 0.0)
        for total, weight, code in zip(totals, weights, groups, strict=True)
    ]
    corner = tuple(m / dr.maximum(t, 1.0) for m, t in zip(masses, totals, strict=True))
    return Shares(corner, 1.0 - sum(masses))


def sample(
    lobes: Lobes, entries: Entries, block: Any, chances: Shares, wo: Any, u: Sequence[Any]
) -> Any:
    """wi in the upper hemisphere: of one specular lobe, or of the cosine lobe.

    Args:
        lobes: of the model.
        entries: specular ones.
        block: of texels.
        chances: at this block and view.
        wo: view.
        u: three numbers in [0, 1).
    """
    wi = square_to_cosine_hemisphere(u[1:])
    if not entries.groups:
        return wi
    ((_, entry, end),) = entries.of(block)

    def passed(entry: Any, left: Any, mass: Any, found: Any) -> tuple[Any, ...]:
        codes = _seen_codes(lobes, entries, entry, wo, len(chances.corner))
        mass = _mixed(codes, chances.corner)
        found = left < mass
        return dr.select(found, entry, entry + 1), dr.select(found, left, left - mass), mass, found

    start = (entry, u[0], mi.Float(1.0), mi.Bool(False))
    go_on = lambda entry, left, mass, found: (found ^ True) & (entry < end)  # noqa: E731
    entry, left, mass, found = loop(start, go_on, passed)
    share = dr.minimum(left / mass, 1.0 - 2.0**-24)
    chosen, _ = row(entries.links, dr.select(found, entry, 0), 2)
    return dr.select(found, lobes.sample(chosen, wo, (share, *u[1:])), wi)


def _seen_codes(lobes: Lobes, entries: Entries, entry: Any, wo: Any, texels: int) -> list[Any]:
    """The codes of an entry in the texels of a block; 0 where the lobe does not see the view wo."""
    lobe, codes = row(entries.links, entry, 2)
    return _bytes(dr.select(lobes.sees(lobe, wo), codes, 0), texels)


def _bytes(word: Any, count: int) -> list[Any]:
    """The first bytes of a word."""
    return [mi.Float((word >> shift) & 255) for shift in range(0, 8 * count, 8)]


def _channels(numbers: Any, entry: Any, weights: Sequence[Any]) -> list[Any]:
    """RGB of an entry, by the weights of the texels of its block."""
    texels = len(weights)
    values = row(numbers, entry, CHANNELS * texels)
    starts = range(0, 3 * texels, texels)
    return [_mixed(values[start : start + texels], weights) for start in starts]


def _mixed(numbers: Sequence[Any], weights: Sequence[Any]) -> Any:
    """The sum of numbers with weights."""
    return sum(n * w for n, w in zip(numbers, weights, strict=True))
