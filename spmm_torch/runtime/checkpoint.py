"""Checkpoints: finished stages on disk, so that a run that was killed goes on where it was."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self, TypeVar

import torch
from torch import Tensor

from ..errors import OutputError
from . import tensor_file
from .atomic import write_atomic
from .ranks import ALONE, Ranks
from .stopwatch import Stopwatch

SECONDS = "seconds"


class Stored(Protocol):
    """What a stage yields: all of it in tensors."""

    def to_tensors(self) -> dict[str, Tensor]: ...

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Self: ...


S = TypeVar("S", bound=Stored)


@dataclass(frozen=True)
class Checkpoint:
    """The finished stages of one run.

    Attributes:
        watch: gets the seconds of stages that an earlier process finished.
        folder: where they lie; None keeps nothing.
        ranks: the processes of the run; the first one writes.
    """

    watch: Stopwatch
    folder: Path | None = None
    ranks: Ranks = field(default=ALONE)

    def once(self, name: str, kind: type[S], compute: Callable[[], S]) -> S:
        """The result of stage `name`: read if an earlier process finished it, else computed.

        Args:
            name: of the stage; also the name of its file.
            kind: class of the result.
            compute: makes the result; all ranks call it together.
        """
        found = self.ranks.first(lambda: self._read(name))
        if found is not None:
            tensors, seconds = found
            for stage, spent in {**seconds, "total": math.fsum(seconds.values())}.items():
                self.watch.seconds[stage] = self.watch.seconds.get(stage, 0.0) + spent
            return kind.from_tensors(tensors)
        before = dict(self.watch.seconds)
        result = compute()
        spent = {k: v - before.get(k, 0.0) for k, v in self.watch.seconds.items()}
        self.ranks.first(lambda: self._keep(name, result, spent))
        return result

    def _keep(self, name: str, result: Stored, spent: dict[str, float]) -> None:
        if self.folder is None:
            return
        content = tensor_file.pack(result.to_tensors(), {SECONDS: json.dumps(spent)})
        write_atomic(self.folder / f"{name}.safetensors", content)

    def _read(self, name: str) -> tuple[dict[str, Tensor], dict[str, float]] | None:
        """What an earlier process kept; None also where a fault of the disk has damaged it."""
        if self.folder is None:
            return None
        try:
            tensors, metadata = tensor_file.read(self.folder / f"{name}.safetensors", "cpu")
        except OutputError:
            return None
        return tensors, json.loads(metadata[SECONDS])


def stage_generator(seed: int, stage: str) -> torch.Generator:
    """The source of randomness of one stage.

    Each has its own, so that a stage that is read instead of computed changes no other.
    """
    digest = hashlib.blake2b(f"{seed}/{stage}".encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") & (2**63 - 1))
