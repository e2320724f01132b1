"""The work of a computation, counted operation by operation while it runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves
from torch.utils.flop_counter import flop_registry

from ..runtime.stopwatch import Stopwatch

ALL = "total"  # the name under which `fit` times all stages together


@dataclass
class Work:
    """Operations and traffic.

    Attributes:
        flops: two for each multiply-add of a matrix product, and one for each value that any
            other operation writes, as a lower bound.
        bytes: read and written by the operations, as if nothing stayed in a cache.
    """

    flops: float = 0.0
    bytes: float = 0.0

    def __add__(self, other: Work) -> Work:
        return Work(self.flops + other.flops, self.bytes + other.bytes)


class WorkCounter(TorchDispatchMode):
    """Counts the work of every operation that runs inside of it; views are free."""

    def __init__(self, work: Work) -> None:
        super().__init__()
        self.work = work

    def __torch_dispatch__(
        self, function: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        """Runs one operation and counts it."""
        kwargs = kwargs or {}
        result = function(*args, **kwargs)
        if not _only_views(function):
            written = [leaf for leaf in tree_leaves(result) if isinstance(leaf, Tensor)]
            read = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, Tensor)]
            self.work.bytes += sum(_bytes(part) for part in (*written, *read))
            formula = flop_registry.get(function.overloadpacket)
            sparse = [part for part in read if part.layout == torch.sparse_csr]
            if sparse and formula is not None:
                self.work.flops += 2.0 * sparse[0]._nnz() * result.shape[-1]
            elif formula is None:
                self.work.flops += sum(_stored(part) for part in written)
            else:
                self.work.flops += formula(*args, **kwargs, out_val=result)
        return result


def _only_views(function: Any) -> bool:
    """Whether an operation returns only views of its input."""
    returned = function._schema.returns
    return bool(returned) and all(
        value.alias_info is not None and not value.alias_info.is_write for value in returned
    )


def _bytes(part: Tensor) -> int:
    """Bytes of a tensor in memory, where broadcast dimensions take no room."""
    if part.layout == torch.sparse_csr:
        parts = (part.crow_indices(), part.col_indices(), part.values())
        return sum(_bytes(each) for each in parts)
    count = 1
    for size, stride in zip(part.shape, part.stride(), strict=True):
        count *= size if stride or size == 0 else 1
    return count * part.element_size()


def _stored(part: Tensor) -> int:
    """Numbers that a tensor holds: of a sparse one, those that are not left out."""
    return part._nnz() if part.layout == torch.sparse_csr else part.numel()


@dataclass
class CountingStopwatch(Stopwatch):
    """A stopwatch that also counts the work of each stage.

    Attributes:
        work: by stage.
    """

    work: defaultdict[str, Work] = field(default_factory=lambda: defaultdict(Work))

    def take(self, other: Stopwatch) -> None:
        """Adds the seconds and the work of another watch."""
        super().take(other)
        if isinstance(other, CountingStopwatch):
            for stage, work in other.work.items():
                self.work[stage] += work

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """One stage, or a part of it."""
        if stage == ALL:
            with super().__call__(stage):
                yield
            return
        with super().__call__(stage), WorkCounter(self.work[stage]):
            yield
