"""Vectors of which each component is a tensor of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import torch
from torch import Tensor


class ByComponent:
    """A tensor `[..., N]` made of its N components, which `[..., i]` gives without a view.

    A view of a component has a gradient as large as all of them, mostly zeros, which is added up
    for each use. Whatever else is done with a tensor is done with that of all components.
    """

    def __init__(self, parts: list[Tensor]) -> None:
        self.parts = parts

    @cached_property
    def whole(self) -> Tensor:
        """The tensor `[..., N]`, each component contiguous."""
        return torch.stack(self.parts).movedim(0, -1)

    def __getitem__(self, index: Any) -> Tensor:
        if isinstance(index, tuple) and index[:1] == (...,) and isinstance(index[-1], int):
            return self.parts[index[-1]] if len(index) == 2 else self.whole[index]
        return self.whole[index]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)

    @classmethod
    def __torch_function__(
        cls, function: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        """The result of a function of torch for the tensor of all components."""
        plain = {name: _plain(part) for name, part in (kwargs or {}).items()}
        return function(*map(_plain, args), **plain)


def _plain(part: Any) -> Any:
    """An argument with tensors in place of components."""
    if isinstance(part, (list, tuple)):
        return type(part)(map(_plain, part))
    return part.whole if isinstance(part, ByComponent) else part


def _operator(name: str) -> Callable[..., Any]:
    def apply(self: ByComponent, *others: Any) -> Any:
        return getattr(self.whole, name)(*map(_plain, others))

    return apply


# Python looks operators up in the class, past `__getattr__`.
for _name in ("add", "sub", "mul", "truediv", "pow", "matmul"):
    for _side in (f"__{_name}__", f"__r{_name}__"):
        setattr(ByComponent, _side, _operator(_side))
for _name in ("__neg__", "__abs__", "__len__", "__lt__", "__le__", "__gt__", "__ge__"):
    setattr(ByComponent, _name, _operator(_name))
