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
from .arrays import columns, loop, one
from .brdf import Twin
from .brdf.warp import cosine_pdf, square_to_cosine_hemisphere
from .libraries import dr, mi
from .lobe import Lobe, Lobes, density, raised

# Numbers of an entry of a block: three channels of four texels.
WEIGHTS = 12


@dataclass(frozen=True)
class Entries:
    """Lobes of the blocks, each once.

    Attributes:
        start: first entry of each of G groups in each block, `[T * G + 1]`.
        used: whether some block has entries of a group, `[G]`. Groups are the BRDFs in use, first
            the entries that are not sampled and then those that are; or one, of all that are.
        lobe: lobe of each entry, `[M]`.
        codes: of its probability in the four texels, a byte each, `[M]`.
    """

    start: Any
    used: tuple[bool, ...]
    lobe: Any
    codes: Any

    def of(self, block: Any, group: int = 0) -> tuple[Any, Any]:
        """(first entry of a group in a block, the one after its last)."""
        first = block * len(self.used) + group
        return one(self.start, first), one(self.start, first + 1)


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
    place: tuple[Any, Sequence[Any]],
    chances: Shares | None,
    lights: Sequence[Any],
    wo: Any,
) -> tuple[list[Any], list[Any]]:
    """The sum over lobes in Eq. 2 [WDR11], RGB, and the density of `sample` in 1/sr, of each wi.

    Both are 0 where wi or wo is under the horizon of the texel.

    Args:
        lobes, entries: of the model, by BRDF.
        numbers: weights of the entries, `[M, 3, 4]`.
        place: a block, and the bilinear weights of its texels.
        chances: of `sample` at this place; None for values alone.
        lights: one or more wi.
        wo: view.
    """
    totals = tuple(mi.Float(0.0) for _ in range(4 * len(lights)))
    corner = chances.corner if chances is not None else ()
    for group in range(len(entries.used)):
        if entries.used[group]:
            totals = _with_group(lobes, entries, numbers, group, totals, place, corner, lights, wo)
    colours, densities = [], []
    for n, wi in enumerate(lights):
        above = (wi.z > 0.0) & (wo.z > 0.0)
        colours.append(dr.select(above, mi.Color3f(*totals[3 * n : 3 * n + 3]), 0.0))
        cosine = 0.0 if chances is None else chances.cosine * cosine_pdf(dr.detach(wi))
        densities.append(dr.select(above, totals[3 * len(lights) + n] + cosine, 0.0))
    return colours, densities


def _with_group(
    lobes: Lobes,
    entries: Entries,
    numbers: Any,
    group: int,
    totals: tuple[Any, ...],
    place: tuple[Any, Sequence[Any]],
    corner: tuple[Any, ...],
    lights: Sequence[Any],
    wo: Any,
) -> tuple[Any, ...]:
    """`totals`, RGB of each wi and then densities, with the entries of a group; see `evaluated`.

    All that has gradients is part of the state of the loop, and sums are added after it: no loop
    may add to what has gradients before it.
    """
    (block, weights), twin, sums = place, lobes.twins[group // 2], len(totals)
    sampled = bool(corner) and group % 2 == 1

    def add(entry: Any, *state: Any) -> tuple[Any, ...]:
        total, wo, weights, lights = state[:sums], state[sums], state[-4:], state[sums + 1 : -4]
        lobe = lobes.of(one(entries.lobe, entry))
        wi, view = [lobe.local(light) for light in lights], lobe.local(wo)
        alpha = _channels(columns(numbers, entry, WEIGHTS, range(WEIGHTS)), weights)
        rho = [lobes.rho(twin, lobe, *each, view) for each in zip(lights, wi, strict=True)]
        parts = [r * a for r in rho for a in alpha]
        parts += [0.0 for _ in lights]
        if sampled:
            codes = one(entries.codes, entry)
            parts[3 * len(lights) :] = _densities(twin, lobe, codes, corner, lights, wi, wo, view)
        more = (t + part for t, part in zip(total, parts, strict=True))
        return entry + 1, *more, wo, *lights, *weights

    entry, end = entries.of(block, group)
    lit = (wo.z > 0.0) & _any([wi.z > 0.0 for wi in lights])
    apart = dr.grad_enabled(totals)
    before = tuple(mi.Float(0.0) for _ in totals) if apart else totals
    start = (dr.select(lit, entry, end), *before, wo, *lights, *weights)
    after = loop(start, lambda entry, *_: entry < end, add)[1 : 1 + sums]
    return tuple(t + part for t, part in zip(totals, after, strict=True)) if apart else after


def _densities(
    twin: Twin,
    lobe: Lobe,
    codes: Any,
    corner: Sequence[Any],
    lights: Sequence[Any],
    wi: Sequence[Any],
    wo: Any,
    view: Any,
) -> list[Any]:
    """What a lobe adds to the density of each wi: local `wi` and `view` of `lights` and `wo`."""
    lobe, wo, view = lobe.detached(), dr.detach(wo), raised(dr.detach(view))
    seen = dr.select(dr.dot(lobe.normal, wo) > 0.0, codes, 0)
    mass = _mixed(_bytes(seen), corner)
    pairs = ((dr.detach(light), dr.detach(local)) for light, local in zip(lights, wi, strict=True))
    return [mass * density(twin, lobe, *pair, view) for pair in pairs]


def shares(
    lobes: Lobes, entries: Entries, group: Any, place: tuple[Any, Sequence[Any]], wo: Any
) -> Shares:
    """The probabilities of specular entries [WDR11 Eq. 9] that see the view wo.

    Args:
        lobes: of the model.
        entries: specular ones.
        group: codes of the specular group of the texels of each block, a byte each, `[T]`.
        place: a block, and the bilinear weights of its texels.
        wo: view.
    """
    if not any(entries.used):
        return Shares((), mi.Float(1.0))
    block, weights = place
    entry, end = entries.of(block)

    def add(entry: Any, *totals: Any) -> tuple[Any, ...]:
        codes = _seen_codes(lobes, entries, entry, wo)
        return entry + 1, *(t + code for t, code in zip(totals, codes, strict=True))

    start = (entry, *(mi.Float(0.0) for _ in range(4)))
    totals = loop(start, lambda entry, *_: entry < end, add)[1:]
    masses = [
        dr.select(total > 0.0, weight * code * (1.0 / CODE_MAX), 0.0)
        for total, weight, code in zip(totals, weights, _bytes(one(group, block)), strict=True)
    ]
    corner = tuple(m / dr.maximum(t, 1.0) for m, t in zip(masses, totals, strict=True))
    return Shares(corner, 1.0 - (masses[0] + masses[1] + masses[2] + masses[3]))


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
    if not any(entries.used):
        return wi
    entry, end = entries.of(block)

    def passed(entry: Any, left: Any, mass: Any, found: Any) -> tuple[Any, ...]:
        mass = _mixed(_seen_codes(lobes, entries, entry, wo), chances.corner)
        found = left < mass
        return dr.select(found, entry, entry + 1), dr.select(found, left, left - mass), mass, found

    start = (entry, u[0], mi.Float(1.0), mi.Bool(False))
    go_on = lambda entry, left, mass, found: (found ^ True) & (entry < end)  # noqa: E731
    entry, left, mass, found = loop(start, go_on, passed)
    share = dr.minimum(left / mass, 1.0 - 2.0**-24)
    chosen = one(entries.lobe, dr.select(found, entry, 0))
    return dr.select(found, lobes.sample(chosen, wo, (share, *u[1:])), wi)


def _seen_codes(lobes: Lobes, entries: Entries, entry: Any, wo: Any) -> list[Any]:
    """The codes of an entry in the four texels; 0 where the lobe does not see the view wo."""
    seen = lobes.sees(one(entries.lobe, entry), wo)
    return _bytes(dr.select(seen, one(entries.codes, entry), 0))


def _bytes(word: Any) -> list[Any]:
    """The four bytes of a word."""
    return [mi.Float((word >> shift) & 255) for shift in (0, 8, 16, 24)]


def _channels(numbers: Sequence[Any], weights: Sequence[Any]) -> list[Any]:
    """RGB of the twelve numbers of an entry, by the bilinear weights of four texels."""
    return [_mixed(numbers[4 * c : 4 * c + 4], weights) for c in range(3)]


def _mixed(numbers: Sequence[Any], weights: Sequence[Any]) -> Any:
    """The sum of four numbers with four weights."""
    return sum(n * w for n, w in zip(numbers, weights, strict=True))


def _any(masks: Sequence[Any]) -> Any:
    """Whether one of some conditions holds."""
    found = masks[0]
    for mask in masks[1:]:
        found = found | mask
    return found
