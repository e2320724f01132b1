"""What a fit may take: memory, disk and processes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .ranks import ALONE, Ranks
from .stopwatch import Stopwatch


@dataclass(frozen=True)
class Resources:
    """With what a fit works; nothing here changes its result.

    Attributes:
        memory: bytes that the process may take; None: half of what is free.
        cache: folder for decoded values; None: the user's own, only for what exceeds the memory.
        state: folder in which finished stages are kept, to go on from; None: nowhere.
        ranks: the processes that share the fit.
        watch: tells the time by stage; None: one of its own.
    """

    memory: int | None = None
    cache: Path | None = None
    state: Path | None = None
    ranks: Ranks = ALONE
    watch: Stopwatch | None = None
