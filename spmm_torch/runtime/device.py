"""Where the work is done, and how exactly."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from ..errors import ConfigError


def resolve_device(name: str) -> torch.device:
    """The device of a setting: `auto` is the GPU where there is one.

    Raises:
        ConfigError: no such device here.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.") from error
    if device.type not in ("cpu", "cuda"):
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.")
    count = torch.cuda.device_count() if device.type == "cuda" else 1
    if (device.index or 0) >= count:
        raise ConfigError(
            f"device is {name!r}, but torch sees {count} CUDA devices here; use --device cpu, or "
            f"install a CUDA build of torch."
        )
    return device


@contextmanager
def full_precision() -> Iterator[None]:
    """Neither TF32 nor bfloat16 in matrix products, whatever the process has asked for.

    Their 10 and 8 bits would drown small lobes in rounding. `set_float32_matmul_precision`, which
    programs call for the sake of networks, turns on TF32 on a GPU and bfloat16 on some CPUs;
    autocast does so for the operations under it.
    """
    products = (torch.backends.cuda.matmul, torch.backends.mkldnn.matmul)
    before = [product.fp32_precision for product in products]
    try:
        for product in products:
            product.fp32_precision = "ieee"
        with torch.autocast("cpu", enabled=False), torch.autocast("cuda", enabled=False):
            yield
    finally:
        for product, precision in zip(products, before, strict=True):
            product.fp32_precision = precision


def local_device(name: str) -> str:
    """The device of this rank: on a machine with several GPUs, each rank has its own."""
    if name in ("auto", "cuda") and torch.cuda.is_available() and "LOCAL_RANK" in os.environ:
        return f"cuda:{int(os.environ['LOCAL_RANK']) % torch.cuda.device_count()}"
    return name
