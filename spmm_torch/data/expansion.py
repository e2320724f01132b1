"""The expansion of codes to linear values: floats as they are, tables of 8 and 16 bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor

from ..runtime.memory import slices
from ..runtime.threads import in_threads

# Pairs of codes that are looked up at once: few enough for the caches of a core, enough that
# threads seldom wait for the interpreter's lock.
LOOKUP_CHUNK = 1 << 17


class Expansion(Protocol):
    """The expansion of codes to linear values.

    Attributes:
        elementwise: whether every code element stands for one value.
    """

    elementwise: ClassVar[bool]

    def __call__(self, codes: Tensor) -> Tensor:
        """Linear values `[..., C]` float32 of codes `[..., B]`, on the device of the codes."""
        ...

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., B]`; both are NaN if any value is."""
        ...


class FloatExpansion:
    """The expansion of float16 or float32 codes, which are linear values already."""

    elementwise: ClassVar[bool] = True

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[..., C]` float32 of codes `[..., C]`."""
        return codes.float()

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., C]`; see `Expansion.bounds`."""
        low, high = codes.aminmax()
        return float(low), float(high)


@dataclass(frozen=True)
class TableExpansion:
    """The expansion of codes of 8 or 16 bits by a rising `table [256]` or `[65536]`.

    A table, unlike a power, gives the same bits at any place of a block, so that a fit does not
    depend on the size of blocks. On a CPU codes of 8 bits are looked up two at a time.
    """

    table: Tensor
    elementwise: ClassVar[bool] = True

    @cached_property
    def pairs(self) -> np.ndarray:
        """The two float32 values of every pair of codes `[65536]`, as one element of 8 bytes."""
        codes = np.arange(1 << 16, dtype=np.uint16).view(np.uint8)
        return self.table.numpy()[codes].view(np.uint64)

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[...]` float32 of codes `[...]` uint8 or uint16."""
        if codes.device.type != "cpu":
            return self.table.to(codes.device)[codes.int()]
        if codes.dtype == torch.uint16:
            return _look_up(self.table.numpy(), codes)
        return _look_up_pairs(self.table.numpy(), self.pairs, codes)

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[...]`; see `Expansion.bounds`."""
        array = codes.numpy()  # torch has no extrema of uint16
        return float(self.table[int(array.min())]), float(self.table[int(array.max())])

    @classmethod
    def gamma(cls, gamma: float, code_max: int = 255) -> TableExpansion:
        """The expansion of a code to `(code / code_max) ** gamma`."""
        codes = torch.arange(code_max + 1, dtype=torch.float64)
        return cls(((codes / code_max) ** gamma).float())


@dataclass(frozen=True)
class DepthExpansion:
    """The expansion of pictures of several depths, by the type of their codes.

    Codes of 8 and 16 bits were encoded with a display gamma; floats are linear values already.
    """

    gamma: float
    elementwise: ClassVar[bool] = True

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[..., C]` float32 of codes `[..., C]` uint8, uint16, float16 or float32."""
        return self._of_type[codes.dtype](codes)

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., C]`; see `Expansion.bounds`."""
        return self._of_type[codes.dtype].bounds(codes)

    @cached_property
    def _of_type(self) -> dict[torch.dtype, Expansion]:
        return {
            torch.uint8: TableExpansion.gamma(self.gamma),
            torch.uint16: TableExpansion.gamma(self.gamma, 65535),
            torch.float16: FloatExpansion(),
            torch.float32: FloatExpansion(),
        }


def _look_up(table: np.ndarray, codes: Tensor) -> Tensor:
    """`table[codes]` of codes `[...]` uint16 on the CPU, in threads."""
    values = torch.from_numpy(np.empty(codes.shape, np.float32))
    source, target = codes.contiguous().view(-1).numpy(), values.view(-1).numpy()

    def work(block: slice) -> None:
        np.take(table, source[block], out=target[block], mode="clip")  # "raise" would copy

    in_threads(work, list(slices(len(source), LOOKUP_CHUNK)))
    return values


def _look_up_pairs(table: np.ndarray, pairs: np.ndarray, codes: Tensor) -> Tensor:
    """`table[codes]` of codes `[...]` uint8 on the CPU, in threads, ten times as fast as by torch.

    `np.take` spends most of its time on the index, and here one index serves two codes.
    """
    values = torch.from_numpy(np.empty(codes.shape, np.float32))  # NumPy allocates huge pages
    source, target = codes.contiguous().view(-1).numpy(), values.view(-1).numpy()
    even = source.size & ~1
    source_pairs, target_pairs = source[:even].view(np.uint16), target[:even].view(np.uint64)

    def work(block: slice) -> None:
        # The mode "raise" would copy.
        np.take(pairs, source_pairs[block], out=target_pairs[block], mode="clip")

    in_threads(work, list(slices(len(source_pairs), LOOKUP_CHUNK)))
    target[even:] = table[source[even:]]
    return values
