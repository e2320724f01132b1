"""BTFs as commands read them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spmm_torch.data import BTF
    from spmm_torch.runtime.progress import Progress


def decode(btf: BTF, progress: Progress, cache: str | None = None) -> None:
    """Decodes a BTF, in memory if it fits there.

    Args:
        btf: the BTF.
        progress: told how far it is.
        cache: folder that keeps the decoded values; the user's own if None.

    Raises:
        DataError: a picture cannot be decoded, or a value is not valid.
        OutputError: the cache cannot be written.
    """
    from spmm_torch.runtime.memory import DEFAULT_FRACTION, free_memory

    for note in btf.notes:
        progress.say(note)
    folder = None if cache is None else Path(cache)
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_FRACTION * free_memory()), cache=folder)
