"""Tensors that say they are on `cuda:0`, live in host memory, and refuse what CUDA refuses.

To torch's own C++ they are on the device "meta", which every build has: so what torch makes inside
of an operation is on the device of its inputs, and gradients need no accelerator. What torch would
then not compute at all is computed here, on the host tensor that each of them holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NoReturn

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from .tally import TO_DEVICE, TO_HOST, Tally, asking_line

CUDA, STAND_IN, HOST = torch.device("cuda", 0), torch.device("meta"), torch.device("cpu")
# Operations that take indices in host memory, too, and scalars beside their indices.
INDEXING = {"index", "index_put", "index_put_", "_index_put_impl_", "_unsafe_index"}
# Operations whose result depends on values, so that the host waits; torch tags the others.
CHECKED = {"_linalg_check_errors"}
DEPENDENT = {torch.Tag.dynamic_output_shape, torch.Tag.data_dependent_output}
# Operations that only set up memory.
IDLE = {"empty", "empty_strided", "empty_like", "new_empty", "new_empty_strided", "_unsafe_view"}


class DeviceTensor(Tensor):
    """A tensor on the simulated device.

    Attributes:
        held: the host tensor with its values.
    """

    held: Tensor
    if not TYPE_CHECKING:
        __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, held: Tensor) -> DeviceTensor:
        """A tensor of the shape, type and layout of `held [...]`."""
        dense = held.layout == torch.strided
        made = torch.Tensor._make_wrapper_subclass(
            cls,
            held.size(),
            strides=held.stride() if dense else None,
            storage_offset=held.storage_offset() if dense else None,
            dtype=held.dtype,
            layout=held.layout,
            device=STAND_IN,
        )
        made.held = held
        return made

    if not TYPE_CHECKING:  # attributes of the base, which stand for values here
        device = property(lambda self: CUDA)
        is_cuda = property(lambda self: True)
        is_meta = property(lambda self: False)
        is_cpu = property(lambda self: False)
        layout = property(lambda self: self.held.layout)

    def __repr__(self, *, tensor_contents: str | None = None) -> str:
        return f"{self.held!r} on {CUDA}"

    def tolist(self) -> Any:
        """Nested lists of the values `[...]`; the host waits."""
        return self.cpu().tolist()

    def numpy(self, *_: object, **__: object) -> NoReturn:
        """Refuses, as CUDA does.

        Raises:
            TypeError: always.
        """
        refuse(TypeError, "NumPy on a device tensor: copy it to host memory first")

    __array__ = numpy

    def data_ptr(self) -> int:
        """The address of the values `[...]`."""
        return self.held.data_ptr()

    def __deepcopy__(self, memo: dict[int, object]) -> Tensor:
        """A copy `[...]` of its own values, as `copy.deepcopy` makes it."""
        made = self.detach().clone().requires_grad_(self.requires_grad)
        made._is_param = getattr(self, "_is_param", False)  # as torch tells parameters
        memo[id(self)] = made
        return made

    @classmethod
    def __torch_dispatch__(
        cls, function: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> NoReturn:
        """Refuses: tensors of the device have left the simulation.

        Raises:
            RuntimeError: always.
        """
        refuse(RuntimeError, f"{function} outside of the simulation")


def refuse(error: type[Exception], sentence: str) -> NoReturn:
    """Raises what CUDA would, with the line that asked."""
    raise error(f"{sentence} (at {asking_line()})")


class Device(TorchDispatchMode):
    """The simulated device: computes on the host what is asked of its tensors, and counts it."""

    def __init__(self, tally: Tally) -> None:
        super().__init__()
        self.tally = tally

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        """Whether torch's compiler is kept away; no, since that imports it, for seconds."""
        return False

    def __torch_dispatch__(
        self, function: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        """The result of an operation, on the device if its inputs or its `device` are."""
        kwargs = dict(kwargs or {})
        kwargs.pop("pin_memory", None)  # the host of a simulation has none
        name = function._schema.name.removeprefix("aten::")
        if name == "_to_copy":
            return self.moved(function, args[0], kwargs)
        if name == "copy_":
            return self.copied(function, *args, **kwargs)
        leaves = list(tensors((args, tuple(kwargs.values()))))
        there = {id(leaf.held): leaf for leaf in leaves if isinstance(leaf, DeviceTensor)}
        if not there and not is_device(kwargs.get("device")):
            return function(*args, **kwargs)
        check(function, name, args, kwargs, leaves)
        self.count(function, name, args, kwargs)
        result = function(*on_host(args), **on_host(kwargs))
        return on_device(result, there if function._schema.is_mutable else {})

    def moved(self, function: Any, source: Tensor, kwargs: dict[str, Any]) -> Tensor:
        """A copy of `source [...]` of another device or type."""
        from_device = isinstance(source, DeviceTensor)
        where = kwargs.pop("device", None)
        to_device = from_device if where is None else is_device(where)
        kwargs.pop("non_blocking", None)
        copy = function(on_host(source), **kwargs)
        if from_device or to_device:
            self.tally.launch("_to_copy")
        if from_device != to_device:
            self.tally.move(TO_DEVICE if to_device else TO_HOST, size_of(copy))
        return DeviceTensor(copy) if to_device else copy

    def copied(self, function: Any, target: Tensor, source: Tensor, *args: Any) -> Tensor:
        """`target [...]` with the values of `source`, which may be on the other device."""
        ways = isinstance(source, DeviceTensor), isinstance(target, DeviceTensor)
        if any(ways):
            self.tally.launch("copy_")
        if ways[0] != ways[1]:
            self.tally.move(TO_DEVICE if ways[1] else TO_HOST, size_of(on_host(source)))
        function(on_host(target), on_host(source), *args)
        return target

    def count(self, function: Any, name: str, args: Any, kwargs: dict[str, Any]) -> None:
        """Counts an operation on the device."""
        if waits(function, name, args, kwargs):
            self.tally.wait(name)
        if name in INDEXING:
            for index in args[1]:
                if index is not None and not isinstance(index, DeviceTensor):
                    self.tally.move(TO_DEVICE, size_of(index))
        if not function.is_view and name not in IDLE:
            self.tally.launch(name)


def waits(function: Any, name: str, args: Any, kwargs: dict[str, Any]) -> bool:
    """Whether the host must wait for values to know the result, or its shape."""
    if name in INDEXING:
        return any(index is not None and index.dtype == torch.bool for index in args[1])
    if kwargs.get("output_size") is not None:  # of repeat_interleave
        return False
    return name in CHECKED or bool(DEPENDENT & set(function.tags))


def check(
    function: Any, name: str, args: Any, kwargs: dict[str, Any], leaves: list[Tensor]
) -> None:
    """Refuses what CUDA refuses, of operands `[...]`.

    Raises:
        RuntimeError: operands on two devices, or a generator of the host.
    """
    generator = kwargs.get("generator")
    if generator is not None and generator.device.type == "cpu":
        refuse(RuntimeError, f"a generator of the host for {name} on {CUDA}")
    if name == "linalg_lstsq" and kwargs.get("driver") not in (None, "gels"):
        refuse(RuntimeError, f"lstsq by driver {kwargs['driver']} on {CUDA}")
    scalars = torch.Tag.pointwise in function.tags or name.rstrip("_") in (*INDEXING, "masked_fill")
    strangers = [x for x in leaves if not isinstance(x, DeviceTensor)]
    if name in INDEXING and isinstance(args[0], DeviceTensor):
        strangers = [x for x in strangers if not any(x is index for index in args[1])]
    if any(x.dim() > 0 or not scalars for x in strangers):
        shapes = ", ".join(f"{list(x.shape)} on {x.device}" for x in leaves)
        refuse(RuntimeError, f"operands of {name} on two devices: {shapes}")


def is_device(where: torch.device | str | None) -> bool:
    """Whether a device is the simulated one, under its own name or as C++ knows it."""
    return where is not None and torch.device(where).type in (CUDA.type, STAND_IN.type)


def size_of(held: Tensor) -> int:
    """Bytes of the values of `held [...]`, with the indices of a sparse one."""
    if held.layout == torch.sparse_csr:
        return sum(part.nbytes for part in (held.crow_indices(), held.col_indices(), held.values()))
    return held.nbytes


def tensors(part: Any) -> Iterator[Tensor]:
    """All tensors `[...]` in nested lists of arguments."""
    if isinstance(part, Tensor):
        yield part
    elif isinstance(part, (list, tuple)):
        for inner in part:
            yield from tensors(inner)


def on_host(part: Any) -> Any:
    """Arguments of an operation with host tensors and the host's device for those simulated."""
    if isinstance(part, DeviceTensor):
        return part.held
    if isinstance(part, (list, tuple)):
        return type(part)(map(on_host, part))
    if isinstance(part, dict):
        return {name: on_host(inner) for name, inner in part.items()}
    return HOST if isinstance(part, torch.device) and is_device(part) else part


def on_device(result: Any, written: dict[int, DeviceTensor]) -> Any:
    """Results of an operation as tensors of the device; those `written` to are told by identity."""
    if isinstance(result, Tensor):
        return written[id(result)] if id(result) in written else DeviceTensor(result)
    if isinstance(result, (list, tuple)):
        return type(result)(on_device(inner, written) for inner in result)
    return result
