"""BTFs as commands read them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spmm_torch.config.fit import DataConfig

if TYPE_CHECKING:
    from spmm_torch.data import BTF
    from spmm_torch.runtime.progress import Progress


def open_btf(path: str, data: DataConfig, seed: int = 0) -> BTF:
    """The BTF of a path, not decoded yet.

    Args:
        path: of any known format.
        data: how it is read, and which part of it.
        seed: of the choice of texels, where only some are taken.

    Raises:
        DataError: nothing there, no known format, or malformed.
        ConfigError: a setting out of its range.
    """
    from spmm_torch.data import Selection, load_btf

    return load_btf(
        path,
        gamma=data.gamma,
        cosine=data.cosine,
        negative=data.negative,
        missing=data.missing,
        selection=Selection(data.crop, data.texels, data.directions),
        seed=seed,
    )


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
    from spmm_torch.runtime.memory import DEFAULT_SHARE, free_memory

    folder = None if cache is None else Path(cache)
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_SHARE * free_memory()), cache=folder)
