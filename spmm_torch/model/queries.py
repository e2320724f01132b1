"""Checks of what a model is asked: directions that are not unit give values of another size."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import DataError
from ..geometry.shapes import broadcast_shape

# Tolerance of the squared length of unit vectors: twice that of the length in files.
SQUARED_TOLERANCE = 4e-3
# Types that are checked; others are refused by what computes with them.
CHECKED = (torch.float32, torch.float64)


@torch.no_grad()
def check_queries(
    *,
    uv: Tensor | None = None,
    u: Tensor | None = None,
    footprint: Tensor | None = None,
    **directions: Tensor,
) -> None:
    """Refuses queries that no model can answer; one look at the device for all of them.

    Args:
        uv: texture coordinates `[..., 2]`.
        u: uniform numbers `[..., 3]`.
        footprint: sides of areas, `[...]`.
        directions: by the name of the argument, `[..., 3]`.

    Raises:
        DataError: a shape is another one, shapes do not broadcast, a number is NaN or infinite, a
            direction is not unit, u is outside of 0 to 1, or a footprint is below 0.
    """
    side = None if footprint is None else footprint[..., None]
    pairs = (("uv", uv), ("u", u), ("footprint", side), *directions.items())
    named = {name: value for name, value in pairs if value is not None}
    for name, value in named.items():
        _check_shape(name, value)
    _check_counts(named)
    given = {
        name: value for name, value in named.items() if value.dtype in CHECKED and value.numel()
    }
    faults = {name: _faults(name, value) for name, value in given.items()}
    if not faults or not bool(torch.stack([fault.any() for fault in faults.values()]).any()):
        return
    name = next(name for name, fault in faults.items() if bool(fault.any()))
    row = int(torch.nonzero(faults[name].flatten())[0])
    bad = ", ".join(
        f"{value:g}" for value in given[name].reshape(-1, given[name].shape[-1])[row].tolist()
    )
    expected, remedy = _EXPECTED.get(name, _UNIT)
    raise DataError(
        f"{name} of query {row} is ({bad}); expected {expected}; {remedy}, or switch this check "
        f"off with model.checks_queries = False."
    )


_UNIT = "a unit vector that points away from the surface", "divide it by its length"
_EXPECTED = {
    "uv": ("two finite numbers", "mend what computes them"),
    "u": ("three numbers from 0 to 1", "mend what draws them"),
    "footprint": ("the side of an area, from 0", "mend what computes it"),
}


def _check_shape(name: str, value: Tensor) -> None:
    """Raises DataError if the last dimension has not the numbers of a query."""
    count = {"uv": 2, "footprint": 1}.get(name, 3)
    if value.shape[-1:] != (count,):
        raise DataError(
            f"{name} has shape {tuple(value.shape)}; expected (..., {count}); bring the {count} "
            f"numbers of each query into the last dimension."
        )


def _check_counts(named: dict[str, Tensor]) -> None:
    """Raises DataError if parts `[..., n]` of queries, by their names, do not broadcast."""
    shapes = {name: tuple(value.shape[:-1]) for name, value in named.items()}
    try:
        broadcast_shape(*shapes.values())
    except RuntimeError as error:
        found = ", ".join(f"{name} of {shape}" for name, shape in shapes.items())
        raise DataError(
            f"queries are {found}; expected shapes that broadcast to one; give each query its own, "
            f"or one to all."
        ) from error


def _faults(name: str, value: Tensor) -> Tensor:
    """Which rows `[...]` of `value [..., n]` are not valid; NaN never is."""
    if name == "uv":
        return ~value.isfinite().all(-1)
    if name == "footprint":
        return ~(value >= 0.0).all(-1)
    if name == "u":
        return ~((value >= 0.0) & (value <= 1.0)).all(-1)
    squared = value.square().sum(-1)
    return ~((squared - 1.0).abs() <= SQUARED_TOLERANCE)
