"""Ranks: the processes that share one fit, by `torch.distributed`; one alone by default."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

from ..errors import SPMMError

T = TypeVar("T")

# How long a rank waits for the others. Rank 0 alone may search for hours; a rank that died is
# noticed by torchrun, which ends the others.
PATIENCE = timedelta(days=7)


@dataclass(frozen=True)
class Ranks:
    """This process among `size` equal ones; every method but `share` must be called by all.

    Attributes:
        rank: number of this process; 0 is the one that writes.
        size: number of processes.
        device: on which sums are made: that of the rank for NCCL, the CPU for gloo.
    """

    rank: int = 0
    size: int = 1
    device: torch.device = torch.device("cpu")

    @property
    def is_first(self) -> bool:
        """Whether this process writes and speaks."""
        return self.rank == 0

    def share(self, items: Tensor) -> Tensor:
        """The consecutive part of `items` that is this rank's."""
        return items.tensor_split(self.size)[self.rank]

    def sum(self, values: Tensor) -> Tensor:
        """The sum over all ranks of tensors of one shape."""
        if self.size == 1:
            return values
        total = values.to(self.device, copy=True)
        with _exchange():
            dist.all_reduce(total)
        return total.to(values.device)

    def gather(self, value: T) -> list[T]:
        """The values of all ranks, in their order."""
        if self.size == 1:
            return [value]
        values: list[T] = [value] * self.size
        with _exchange():
            dist.all_gather_object(values, value)
        return values

    def first(self, compute: Callable[[], T]) -> T:
        """What `compute` gives on rank 0; if it fails there, it fails everywhere."""
        if self.size == 1:
            return compute()
        outcome: list[tuple[T | None, BaseException | None]] = [(None, None)]
        if self.is_first:
            try:
                outcome = [(compute(), None)]
            except Exception as error:
                outcome = [(None, error)]
        with _exchange():
            dist.broadcast_object_list(outcome)
        value, error = outcome[0]
        if error is not None:
            raise error
        return value  # type: ignore[return-value]


ALONE = Ranks()


@contextmanager
def _exchange() -> Iterator[None]:
    """One sentence instead of the many of a connection that another rank has closed."""
    try:
        yield
    except RuntimeError as error:
        reason = str(error).partition("\n")[0].partition(". ")[0]
        raise SPMMError(
            f"another process of this run has failed ({reason}); its own message tells why; mend "
            f"that and go on with --resume."
        ) from error


@contextmanager
def joined_ranks(device: torch.device) -> Iterator[Ranks]:
    """The ranks that `torchrun` started, this one being on `device`; alone without `torchrun`."""
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield ALONE
        return
    on_gpu = device.type == "cuda"
    # NCCL wants a GPU for each rank; where they share one, sums go by way of the CPU.
    by_nccl = on_gpu and local_count() <= torch.cuda.device_count()
    if on_gpu:
        torch.cuda.set_device(device)  # objects travel by the current device
    dist.init_process_group("nccl" if by_nccl else "gloo", timeout=PATIENCE)
    try:
        where = device if by_nccl else torch.device("cpu")
        yield Ranks(dist.get_rank(), dist.get_world_size(), where)
    finally:
        dist.destroy_process_group()


def local_count() -> int:
    """How many ranks `torchrun` started on this machine; 1 without it."""
    return int(os.environ.get("LOCAL_WORLD_SIZE", "1"))


def speaks() -> bool:
    """Whether this process is the one that prints: the first of `torchrun`'s, or alone."""
    return int(os.environ.get("RANK", "0")) == 0
