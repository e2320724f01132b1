"""The device to compute on, and the precision of matrix products."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import torch
from torch import Tensor

from ..errors import ConfigError
from .ranks import launched


def resolve_device(name: str) -> torch.device:
    """The device of a name; `auto` is the GPU if there is one.

    Raises:
        ConfigError: there is no such device.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.") from error
    if device.type not in ("cpu", "cuda") or (device.type == "cpu" and device.index):
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.")
    count = torch.cuda.device_count()
    if device.type == "cuda" and (device.index or 0) >= count:
        raise ConfigError(
            f"device is {name!r}, but torch sees {count} CUDA devices here; use --device cpu, or "
            f"install a CUDA build of torch."
        )
    return device


@contextmanager
def full_precision() -> Iterator[None]:
    """Matrix products in full float32, without TF32 or bfloat16, whatever the process has set.

    The 10 and 8 bits of these types would lose small lobes to rounding. Training code turns them on
    by `set_float32_matmul_precision` and by autocast.
    """
    # The type stubs of torch lack `mkldnn.matmul`.
    products = (torch.backends.cuda.matmul, cast("Any", torch.backends.mkldnn).matmul)
    before = [product.fp32_precision for product in products]
    try:
        for product in products:
            product.fp32_precision = "ieee"
        with torch.autocast("cpu", enabled=False), torch.autocast("cuda", enabled=False):
            yield
    finally:
        for product, precision in zip(products, before, strict=True):
            product.fp32_precision = precision


@contextmanager
def plain_torch() -> Iterator[None]:
    """PyTorch as it starts: float32 by default and no inference mode, whatever the program has set.

    A fit differentiates, and makes many small tensors. The default type is one for all threads.
    """
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    try:
        with torch.inference_mode(False):
            yield
    finally:
        torch.set_default_dtype(before)


def asks(tensor: Tensor, number: int, every: int) -> bool:
    """Whether a loop asks at step `number` if it is done: on a GPU, whose host waits, seldom.

    Args:
        tensor: one of the loop, `[...]`, on its device.
        number: steps that were taken.
        every: steps after which a GPU is asked.
    """
    return not tensor.is_cuda or (number > 0 and number % every == 0)


def local_device(name: str) -> str:
    """The name of the device of this rank; several GPUs are dealt out to the ranks in turn."""
    rank = launched("LOCAL_RANK", -1)
    if rank >= 0 and name in ("auto", "cuda") and torch.cuda.is_available():
        return f"cuda:{rank % torch.cuda.device_count()}"
    return name
