"""What a part of a BTF keeps of the whole: its gaps, names and places in the source."""

from __future__ import annotations

from torch import Tensor

from ..errors import DataError


def kept_gaps(missing: Tensor | None, views: Tensor | None, lights: Tensor | None) -> Tensor | None:
    """The missing pairs `[V', L']` of the directions that stay; None if there are none.

    Args:
        missing: of the whole, `[V, L]` bool.
        views, lights: indices `[V']`, `[L']` of those that stay; None: all.

    Raises:
        DataError: all pairs that stay are missing.
    """
    if missing is None:
        return None
    kept = missing if views is None else missing[views]
    kept = kept if lights is None else kept[:, lights]
    if bool(kept.all()):
        raise DataError(
            "all pairs of the chosen directions are missing; expected at least one with a picture; "
            "choose others."
        )
    return kept if bool(kept.any()) else None


def kept_names(names: tuple[str, ...] | None, texels: Tensor | None) -> tuple[str, ...] | None:
    """The names of the texels `[T']` that stay; None: all do."""
    if names is None or texels is None:
        return names
    return tuple(names[index] for index in texels.tolist())


def chosen(before: Tensor | None, index: Tensor | None) -> Tensor | None:
    """Indices `[n]` into the source of an index into `before`, a choice from it; None: all."""
    if before is None or index is None:
        return before if index is None else index
    return before[index]
