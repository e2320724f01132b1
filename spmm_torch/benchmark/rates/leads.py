"""Where a peer is ahead of us: at which bytes, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from .subject import COSTS, QUALITIES, Row

# Sign of each quality by which more is better.
SIGNS = {"snr_db": 1.0, "flip": -1.0}
# Bytes in all of a point that counts over bytes a texel, in units of those of our largest point:
# the basis of as many components, and of a mean beside them, is not to be left out.
ROOM = 1.25


def comparable(rows: Sequence[Row], cost: str) -> list[Row]:
    """Points that a plot over some cost shows.

    A small texture has so few texels for each component of a cluster that many components can hold
    it all. Over bytes a texel, points that take `ROOM` times the bytes of our largest one in all
    are left out.

    Args:
        rows: points of one material.
        cost: key of a point.
    """
    if cost == "bytes":
        return list(rows)
    most = max((row["bytes"] for row in rows if row["ours"]), default=0)
    return [row for row in rows if row["bytes"] <= ROOM * most]


def leads_of(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """All ranges of bytes in which a peer is ahead of our best point of no more bytes.

    Args:
        rows: points of one material.

    Returns:
        For each range `curve` (of the peer), `cost` and `quality` (keys of a point), `first` and
        `end` (bytes; the end does not count, null: there is none), and `lead`: the largest, in the
        unit of the quality; null where we have no point of so few bytes.
    """
    ours = [row for row in rows if row["ours"]]
    found = []
    for cost in COSTS:
        others = [row for row in comparable(rows, cost) if not row["ours"]]
        for quality in QUALITIES:
            if any(row[quality] is None for row in rows):
                continue
            for curve in dict.fromkeys(row["curve"] for row in others):
                peer = [row for row in others if row["curve"] == curve]
                facts = {"curve": curve, "cost": cost, "quality": quality}
                found += [{**facts, **span} for span in _spans(peer, ours, cost, quality)]
    return found


def _spans(
    peer: Sequence[Row], ours: Sequence[Row], cost: str, quality: str
) -> list[dict[str, Any]]:
    """The ranges of one peer: where neighbouring bytes are alike, they are one range."""
    steps = sorted({row[cost] for row in (*peer, *ours)})
    states = [_state(peer, ours, cost, quality, step) for step in steps]
    spans = []
    for (ahead, unrivalled), run in groupby(enumerate(states), lambda each: each[1][:2]):
        numbers = [number for number, _ in run]
        if not ahead:
            continue
        end = numbers[-1] + 1
        spans.append(
            {
                "first": steps[numbers[0]],
                "end": steps[end] if end < len(steps) else None,
                "lead": None if unrivalled else max(states[number][2] for number in numbers),
            }
        )
    return spans


def _state(
    peer: Sequence[Row], ours: Sequence[Row], cost: str, quality: str, size: float
) -> tuple[bool, bool, float]:
    """Whether a peer is ahead at some bytes, whether we have nothing there, and by how much."""
    best = [
        max((SIGNS[quality] * row[quality] for row in rows if row[cost] <= size), default=None)
        for rows in (peer, ours)
    ]
    theirs, own = best
    if theirs is None or own is None:
        return theirs is not None, theirs is not None, 0.0
    return theirs > own, False, theirs - own
