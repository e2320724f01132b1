"""Ranks: the processes of `torch.distributed` that share one fit; a single one by default."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar, cast

import torch
import torch.distributed as dist
from torch import Tensor
from torch.distributed.rendezvous import rendezvous

from ..errors import SPMMError

T = TypeVar("T")

# Variables of `torchrun` that hold numbers.
NUMBERS = ("RANK", "WORLD_SIZE", "MASTER_PORT")
# Time that a rank waits for the others. Rank 0 alone may search for hours; if a rank dies, torchrun
# ends the others.
TIMEOUT = timedelta(days=7)
# Time within which all ranks must have begun: variables of `torchrun` may be left from elsewhere.
MEETING = timedelta(minutes=10)


@dataclass(frozen=True)
class Ranks:
    """This process among `size` processes; all of them must call every method but `share`.

    Attributes:
        rank: number of this process; the one with 0 writes.
        size: number of processes.
        device: device of sums: that of the rank for NCCL, the CPU for gloo.
    """

    rank: int = 0
    size: int = 1
    device: torch.device = torch.device("cpu")

    @property
    def is_first(self) -> bool:
        """Whether this process writes files and messages."""
        return self.rank == 0

    def share(self, items: Tensor) -> Tensor:
        """The items `[n, ...]` of this rank: a consecutive part of `items [N, ...]`."""
        return items.tensor_split(self.size)[self.rank]

    def span(self, count: int) -> tuple[int, int]:
        """First and end of the items of this rank, of `count` in all; see `share`."""
        own = self.share(torch.arange(count)).tolist()
        return (own[0], own[-1] + 1) if own else (0, 0)

    def sum(self, values: Tensor) -> Tensor:
        """The sum `[...]` over all ranks of their `values [...]`, equal in shape.

        Raises:
            SPMMError: another rank has failed.
        """
        if self.size == 1:
            return values
        total = values.to(self.device, copy=True)
        with _exchange():
            dist.all_reduce(total)
        return total.to(values.device)

    def gather(self, value: T) -> list[T]:
        """The values of all ranks, in the order of ranks.

        Raises:
            SPMMError: another rank has failed.
        """
        if self.size == 1:
            return [value]
        values: list[T] = [value] * self.size
        with _exchange():
            dist.all_gather_object(values, value)
        return values

    def first(self, compute: Callable[[], T]) -> T:
        """The result of `compute` on rank 0; an error there is raised on all ranks.

        Raises:
            SPMMError: another rank has failed.
        """
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
        return cast("T", value)


ALONE = Ranks()


@contextmanager
def _exchange() -> Iterator[None]:
    """Turns the error of a connection that another rank has closed into an SPMMError."""
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
    """The ranks that `torchrun` started, this one on `device`; a single one without `torchrun`."""
    if launched("WORLD_SIZE", 1) == 1:
        yield ALONE
        return
    on_gpu = device.type == "cuda"
    # NCCL needs one GPU for each rank; ranks that share a GPU add on the CPU.
    by_nccl = on_gpu and local_count() <= torch.cuda.device_count()
    if on_gpu:
        torch.cuda.set_device(device)  # NCCL sends objects from the current device
    _meet("nccl" if by_nccl else "gloo")
    try:
        where = device if by_nccl else torch.device("cpu")
        yield Ranks(dist.get_rank(), dist.get_world_size(), where)
    finally:
        dist.destroy_process_group()


def _meet(backend: str) -> None:
    """Waits for all ranks.

    Raises:
        SPMMError: one has a number that cannot be, or they cannot reach each other.
    """
    rank, size = launched("RANK", 0), launched("WORLD_SIZE", 1)
    try:
        if rank >= size:
            raise ValueError(f"RANK is {rank} of WORLD_SIZE {size}")
        # torch asks for a host that is not known again and again.
        socket.getaddrinfo(os.environ["MASTER_ADDR"], os.environ["MASTER_PORT"])
        store, rank, size = next(iter(rendezvous("env://", timeout=MEETING)))
        store.set_timeout(TIMEOUT)
        dist.init_process_group(backend, store=store, rank=rank, world_size=size, timeout=TIMEOUT)
    except (RuntimeError, ValueError, OSError) as error:  # among them DistNetworkError
        reason = str(error).partition("\n")[0].partition(". ")[0]
        address = ":".join(os.environ[key] for key in ("MASTER_ADDR", "MASTER_PORT"))
        raise SPMMError(
            f"the processes of this run cannot meet at {address} ({reason}); expected all of them "
            f"and a free port; start them by torchrun, or unset WORLD_SIZE to run alone."
        ) from error


def local_count() -> int:
    """The number of ranks that `torchrun` started on this machine; 1 without it."""
    return launched("LOCAL_WORLD_SIZE", 1)


def speaks() -> bool:
    """Whether this process prints: rank 0 of `torchrun`, or a single process."""
    return launched("RANK", 0) == 0


def launched(name: str, alone: int) -> int:
    """A number that `torchrun` tells by a variable; `alone` for a process that it did not start.

    Job systems and shells leave some of these variables behind, also empty ones: only all of them
    together, with numbers, are those of `torchrun`.
    """
    given = [os.environ.get(key, "") for key in NUMBERS]
    if not os.environ.get("MASTER_ADDR") or not all(map(str.isdecimal, given)):
        return alone
    value = os.environ.get(name, "")
    return int(value) if value.isdecimal() else alone
