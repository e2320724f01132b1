"""Checkpoints: results of finished stages on disk, from which a killed run resumes."""

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

# Key of the metadata: seconds by stage, as JSON.
SECONDS = "seconds"


class Stored(Protocol):
    """The result of a stage, which tensors can hold."""

    def to_tensors(self) -> dict[str, Tensor]:
        """The result as named tensors `[...]` of any shape and type."""
        ...

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Self:
        """The result that `to_tensors` gave as `tensors`, `[...]` each."""
        ...


S = TypeVar("S", bound=Stored)


@dataclass(frozen=True)
class Checkpoint:
    """The finished stages of one run.

    Attributes:
        watch: stopwatch, to which the seconds of stages of an earlier process are added.
        folder: folder of the results; None: nothing is kept.
        ranks: processes of the run; the first one writes.
    """

    watch: Stopwatch
    folder: Path | None = None
    ranks: Ranks = field(default=ALONE)

    def once(self, name: str, kind: type[S], compute: Callable[[], S]) -> S:
        """The result of stage `name`: read if an earlier process finished it, else computed.

        Args:
            name: name of the stage and of its file.
            kind: class of the result.
            compute: function that computes the result; all ranks call it together.

        Raises:
            OSError: the result cannot be written.
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
        """Tensors and seconds that an earlier process kept; None if missing or damaged."""
        if self.folder is None:
            return None
        try:
            tensors, metadata = tensor_file.read(self.folder / f"{name}.safetensors", "cpu")
        except OutputError:
            return None
        return tensors, json.loads(metadata[SECONDS])


def stage_generator(seed: int, stage: str) -> torch.Generator:
    """The random generator of one stage.

    Each stage has its own, so that reading one instead of computing it changes no other.
    """
    digest = hashlib.blake2b(f"{seed}/{stage}".encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") & (2**63 - 1))
