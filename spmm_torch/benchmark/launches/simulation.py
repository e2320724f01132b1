"""`simulated_cuda`: within it, `torch` finds one CUDA device, which is simulated."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from .device_tensor import CUDA, STAND_IN, Device, is_device
from .tally import Tally

MEMORY = 80 << 30
# Functions that make a tensor of other data in C++, past every mode.
MAKERS = {torch.tensor, torch.as_tensor, torch.asarray}
# What torch tells about the device: its counts of memory are not simulated.
ANSWERS: dict[str, object] = {
    "is_available": True,
    "device_count": 1,
    "current_device": 0,
    "mem_get_info": (MEMORY, MEMORY),
    "get_device_name": "simulated",
    "get_device_properties": SimpleNamespace(name="simulated", total_memory=MEMORY),
    "memory_allocated": 0,
    "max_memory_allocated": 0,
    "memory_reserved": 0,
    "max_memory_reserved": 0,
    "empty_cache": None,
    "reset_peak_memory_stats": None,
    "set_device": None,
    "_lazy_init": None,
}


class StandIn(TorchFunctionMode):
    """Takes "cuda" for the device that stands in for it, before C++ sees the name."""

    def __torch_function__(
        self, function: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        """The result of a function of torch."""
        kwargs = dict(kwargs or {})
        if function is Tensor.cuda:
            return args[0].to(STAND_IN)
        if function is Tensor.to:
            args = tuple(STAND_IN if names_device(part) else part for part in args)
        if function is Tensor.new_tensor:
            function, like, args = torch.tensor, args[0], args[1:]
            kwargs = {"dtype": like.dtype, "device": like.device, **kwargs}
        where = kwargs.get("device")
        if not names_device(where):
            return function(*args, **kwargs)
        if function in MAKERS:
            del kwargs["device"]
            return function(*args, **kwargs).to(STAND_IN)
        return function(*args, **{**kwargs, "device": STAND_IN})


def names_device(part: object) -> bool:
    """Whether an argument names the simulated device."""
    if isinstance(part, str):
        return part.partition(":")[0] == CUDA.type
    return isinstance(part, torch.device) and is_device(part)


@contextmanager
def simulated_cuda(by_line: bool = False) -> Iterator[Tally]:
    """One simulated CUDA device for this thread and all that start under `with`; its counts.

    Args:
        by_line: whether the lines that launch work are noted, too.
    """
    tally, run = Tally(by_line=by_line), threading.Thread.run

    def run_with_device(thread: threading.Thread) -> None:
        with StandIn(), Device(tally):
            run(thread)

    with ExitStack() as stack:
        for name, answer in ANSWERS.items():
            stack.enter_context(patch.object(torch.cuda, name, always(answer)))
        wait = lambda *_: tally.wait("synchronize")  # noqa: E731
        stack.enter_context(patch.object(torch.cuda, "synchronize", wait))
        stack.enter_context(patch.object(threading.Thread, "run", run_with_device))
        stack.enter_context(StandIn())
        stack.enter_context(Device(tally))
        yield tally


def always(answer: object) -> Callable[..., Any]:
    """A function that gives `answer`, whatever it is asked."""
    return lambda *_, **__: answer
