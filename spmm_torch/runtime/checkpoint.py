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

# Keys of the metadata: seconds by stage, as JSON, what the result depends on, and a hash of it.
SECONDS, DEPENDS_ON, CONTENT = "seconds", "depends_on", "content"
# Stage of the stopwatch that all others are part of.
TOTAL = "total"
# What a file raises that holds something else than its stage expects.
MISFITS = (OutputError, KeyError, ValueError, TypeError, RuntimeError, IndexError)


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
        depends_on: key of all that the results depend on; files with another one are made anew.
        say: told in one line of a file that cannot be used.
    """

    watch: Stopwatch
    folder: Path | None = None
    ranks: Ranks = field(default=ALONE)
    depends_on: str = ""
    say: Callable[[str], object] = field(default=str)  # nobody is told

    def once(self, name: str, kind: type[S], compute: Callable[[], S]) -> S:
        """The result of stage `name`: read if an earlier process finished it, else computed.

        Args:
            name: name of the stage and of its file.
            kind: class of the result.
            compute: function that computes the result; all ranks call it together.

        Raises:
            OSError: the result cannot be written.
        """
        found = self._found(name, kind)
        if found is not None:
            result, seconds = found
            for stage, spent in {**seconds, TOTAL: math.fsum(seconds.values())}.items():
                self.watch.seconds[stage] = self.watch.seconds.get(stage, 0.0) + spent
            return result
        if self.folder is None:
            return compute()
        self.watch.count_up()  # of stages that began before, and go on
        before = dict(self.watch.seconds)
        result = compute()
        self.watch.count_up()
        spent = {k: v - before.get(k, 0.0) for k, v in self.watch.seconds.items() if k != TOTAL}
        self.ranks.first(lambda: self._keep(name, result, spent))
        return result

    def _found(self, name: str, kind: type[S]) -> tuple[S, dict[str, float]] | None:
        """Result and seconds that an earlier process kept; None if there are none to use."""
        try:
            read = self.ranks.first(lambda: self._read(name))
            return None if read is None else (kind.from_tensors(read[0]), read[1])
        except MISFITS as error:
            if self.ranks.is_first:
                reason = " ".join(str(error).split()) or type(error).__name__
                self.say(f"{name}: what an earlier process kept cannot be used ({reason}); anew")
            return None

    def _keep(self, name: str, result: Stored, spent: dict[str, float]) -> None:
        assert self.folder is not None
        tensors = {name: part.detach().cpu() for name, part in result.to_tensors().items()}
        facts = {
            SECONDS: json.dumps(spent),
            DEPENDS_ON: self.depends_on,
            CONTENT: content_hash(name, tensors),
        }
        write_atomic(self.folder / f"{name}.safetensors", tensor_file.pack(tensors, facts))

    def _read(self, name: str) -> tuple[dict[str, Tensor], dict[str, float]] | None:
        """Tensors and seconds that an earlier process kept; None if it kept none.

        Raises:
            OutputError: the file is damaged.
            ValueError: it is of another run or stage, holds other values than were written, or
                tells no seconds.
        """
        path = None if self.folder is None else self.folder / f"{name}.safetensors"
        if path is None or not path.exists():
            return None
        tensors, metadata = tensor_file.read(path, "cpu")
        if metadata.get(DEPENDS_ON) != self.depends_on:
            raise ValueError("it was made of another input, or with other settings")
        if metadata.get(CONTENT) != content_hash(name, tensors):
            raise ValueError("it holds other values than were written")
        seconds = dict(json.loads(metadata.get(SECONDS, "")))
        return tensors, {stage: float(spent) for stage, spent in seconds.items()}


def content_hash(stage: str, tensors: dict[str, Tensor]) -> str:
    """The hash of a stage and its tensors `[...]`: names, types, shapes and values; in hexadecimal.

    They lie on the CPU, without gradients.

    A crash of the machine may leave a file of the right size with blocks that were never written.
    """
    digest = hashlib.blake2b(stage.encode(), digest_size=16)
    for name, tensor in sorted(tensors.items()):
        digest.update(repr((name, str(tensor.dtype), tuple(tensor.shape))).encode())
        digest.update(tensor.contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def stage_generator(seed: int, stage: str) -> torch.Generator:
    """The random generator of one stage.

    Each stage has its own, so that reading one instead of computing it changes no other.
    """
    digest = hashlib.blake2b(f"{seed}/{stage}".encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") & (2**63 - 1))
