"""Flat arrays of a variant and reads from them: the same code for one ray and for a wavefront.

In a JIT variant, arrays are those of Dr.Jit and a read is a gather for every ray. In a scalar
variant, arrays are plain ones of Dr.Jit and a read gives numbers of Python.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .libraries import dr, mi

# Least divisor: the smallest normal number of float32.
SMALLEST = 2.0**-126
# Bits of a number in [0, 1), and those of a hash beyond them.
MANTISSA, UNUSED_BITS = 24, 8
# Odd factor by which two numbers that are equal differ in a hash: 2^32 over the golden ratio.
MIXER = 0x9E3779B1
# Bytes of the widest read, at whose multiples arrays begin.
ALIGNMENT = 64
# Bits that a whole number has.
WORD = 0xFFFFFFFF


def is_jit() -> bool:
    """Whether the variant works on wavefronts."""
    return bool(dr.is_jit_v(mi.Float))


def has_gradients() -> bool:
    """Whether the variant differentiates."""
    return bool(dr.is_diff_v(mi.Float))


def float_array(values: Tensor | np.ndarray) -> Any:
    """Numbers `[...]` as a flat float32 array."""
    kind = mi.Float if is_jit() else import_module("drjit.scalar").ArrayXf
    return kind(_flat(values, np.float32))


def half_array(values: np.ndarray) -> Any:
    """Numbers `[...]` as a flat array of halves; single floats in a scalar variant."""
    if not is_jit():
        return float_array(values)
    return dr.float16_array_t(mi.Float)(_flat(values, np.float16))


def index_array(values: Tensor | np.ndarray) -> Any:
    """Whole numbers `[...]`, not negative, as a flat array."""
    kind = mi.UInt32 if is_jit() else import_module("drjit.scalar").ArrayXu
    return kind(_flat(values, np.uint32))


def tensor(values: Tensor) -> Any:
    """Numbers `[...]` as a tensor of the variant, which keeps its shape."""
    return mi.TensorXf(float_array(values), tuple(values.shape))


def taken(source: Any, index: Any, counts: Any) -> Any:
    """The entries `index [n]` of a flat array, 0 where `counts [n]` is 0; differentiable."""
    if not len(index):  # Dr.Jit compares no empty array
        return type(source)()
    return dr.gather(type(source), source, index, counts != 0)


def joined(parts: Sequence[Any]) -> Any:
    """Flat arrays one after another."""
    if is_jit():
        return dr.concat(list(parts))
    return float_array(np.concatenate([np.array(part) for part in parts]))


def row(source: Any, index: Any, count: int) -> list[Any]:
    """Row `index` of a table of `count` numbers a row; powers of two are read at once."""
    if not is_jit():
        return [source[count * index + n] for n in range(count)]
    if count == 1:
        return [one(source, index)]
    kind = dr.replace_type_t(mi.ArrayXf, dr.type_v(source))
    return list(dr.gather(kind, source, index, shape=(count, dr.width(index))))


def power_of_two(count: int) -> int:
    """The least power of two that is not below a count."""
    return 1 << max(count - 1, 0).bit_length()


def drawn(*numbers: Any) -> tuple[Any, Any]:
    """Two numbers in [0, 1) that look random: a hash of the bits of four numbers [ZOC10]."""
    first, second, third, fourth = (_bits(number) for number in numbers)
    mixed = (first ^ (third * MIXER) & WORD, second ^ (fourth * MIXER) & WORD)
    hashed = mi.sample_tea_32(*mixed)
    return tuple(mi.Float(number >> UNUSED_BITS) * 2.0**-MANTISSA for number in hashed)


def one(source: Any, index: Any) -> Any:
    """The number at a place of a flat array."""
    if not is_jit():
        return source[index]
    return dr.gather(type(source), source, index)


def loop(state: tuple[Any, ...], while_: Callable[..., Any], body: Callable[..., Any]) -> Any:
    """The state after a loop, part of the kernel of the scene also where that has others.

    Differentiable parts of the state may stay as they are, or be added to, and no more: then the
    derivative is a loop as well.
    """
    mode = "symbolic" if is_jit() else "scalar"
    return dr.while_loop(state, while_, body, mode=mode, max_iterations=-1)


def branch(condition: Any, function: Callable[..., Any], otherwise: Any, *given: Any) -> Any:
    """function(*given) where a condition holds, else another value."""

    def taken(otherwise: Any, *given: Any) -> tuple[Any, ...]:
        return function(*given), *given

    def passed(otherwise: Any, *given: Any) -> tuple[Any, ...]:
        return otherwise, *given

    mode = "symbolic" if is_jit() else "scalar"
    return dr.if_stmt((otherwise, *given), condition, taken, passed, mode=mode)[0]


def _bits(x: Any) -> Any:
    """The bits of a number."""
    if is_jit():
        return dr.reinterpret_array(mi.UInt32, dr.detach(x))
    return int(np.float32(x).view(np.uint32))


def _flat(values: Tensor | np.ndarray, kind: type) -> np.ndarray:
    """All numbers in aligned memory.

    Dr.Jit keeps an array of NumPy where it is, and reads rows of unaligned memory number by number.
    """
    if isinstance(values, torch.Tensor):
        values = values.detach().cpu().numpy()
    size = values.size * np.dtype(kind).itemsize
    memory = np.empty(size + ALIGNMENT, dtype=np.uint8)
    first = -memory.ctypes.data % ALIGNMENT
    flat = memory[first : first + size].view(kind)
    flat[:] = values.ravel()
    return flat
