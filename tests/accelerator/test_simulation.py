"""The simulated device refuses, computes and counts as CUDA does, and is gone afterwards."""

from __future__ import annotations

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from torch import Tensor, nn

from spmm_torch.benchmark.launches.simulation import simulated_cuda
from spmm_torch.benchmark.launches.tally import TO_DEVICE, TO_HOST, Tally

HERE = "accelerator/test_simulation.py"
REFUSED: dict[str, tuple[Callable[[Tensor, Tensor], object], str]] = {
    "elementwise": (lambda host, there: host + there, "add on two devices"),
    "in place": (lambda host, there: there.mul_(host), "mul_ on two devices"),
    "product": (lambda host, there: there @ host, "mm on two devices"),
    "cat": (lambda host, there: torch.cat((host, there)), "cat on two devices"),
    "factory of torch": (lambda host, there: torch.minimum(torch.zeros(2, 2), there), "minimum"),
    "host tensor by device index": (lambda host, there: host[there[0].long()], "index on two"),
    "values to put": (lambda host, there: there.index_put_((host[0].long(),), host), "index_put_"),
    "index_select": (lambda host, there: there.index_select(0, host[0].long()), "index_select"),
    "sum of one": (lambda host, there: torch.cat((host[0, :1], there[0, :1])), "cat"),
    "generator": (lambda _, there: there.uniform_(generator=torch.Generator()), "generator"),
    "numpy": (lambda _, there: there.numpy(), "NumPy"),
    "numpy by array": (lambda _, there: torch.from_numpy(there.__array__()), "NumPy"),
}


def pair() -> tuple[Tensor, Tensor]:
    """The same values `[2, 2]` on the host and on the device."""
    host = torch.tensor([[0.0, 1.0], [1.0, 2.0]])
    return host, host.cuda()


@pytest.mark.parametrize("name", REFUSED)
def test_what_cuda_refuses(name: str, cuda: Tally) -> None:
    ask, sentence = REFUSED[name]
    with pytest.raises((RuntimeError, TypeError), match=f"{sentence}.*at {HERE}:"):
        ask(*pair())


ALLOWED: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "scalar of the host": lambda host, there: there * host[1, 1],
    "where with scalars": lambda host, there: torch.where(there > 0.5, there, host[0, 0]),
    "host index": lambda host, there: there[host[0].long()],
    "host mask": lambda host, there: there[host > 0.5],
    "value put by a host index": lambda host, there: there.index_put((host[0].long(),), host[0, 1]),
    "copied into": lambda host, there: torch.zeros_like(there).copy_(host),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_what_cuda_takes(name: str, cuda: Tally) -> None:
    host, there = pair()
    found = ALLOWED[name](host, there)
    assert found.is_cuda
    assert torch.equal(found.cpu(), ALLOWED[name](host, host))


MADE: dict[str, Callable[[Tensor], Tensor]] = {
    "tensor": lambda there: torch.tensor([1.0], device="cuda"),
    "as_tensor": lambda there: torch.as_tensor([1.0], device=there.device),
    "new_tensor": lambda there: there.new_tensor([1.0]),
    "new_zeros": lambda there: there.new_zeros(3),
    "ones": lambda there: torch.ones(3, device="cuda:0"),
    "to another": lambda there: torch.ones(3).to(there),
    "to a name and type": lambda there: torch.ones(3).to("cuda", torch.float64),
    "module": lambda there: nn.Linear(2, 2).to("cuda").weight,
    "copied module": lambda there: copy.deepcopy(nn.Linear(2, 2).to("cuda")).weight,
    "inside of torch": lambda there: torch.cdist(there, there),
}


@pytest.mark.parametrize("name", MADE)
def test_what_is_made_on_the_device(name: str, cuda: Tally) -> None:
    made = MADE[name](torch.ones(2, 2, device="cuda"))
    assert made.device == torch.device("cuda", 0)
    assert made.is_cuda and not made.is_cpu and not made.cpu().is_cuda
    assert made.cpu().isfinite().all()


def test_operations_waits_and_bytes_are_counted(cuda: Tally) -> None:
    there = torch.arange(6.0).cuda()
    view = there.view(2, 3).T
    assert not cuda.launches.keys() - {"_to_copy"}  # views launch nothing
    positive = view[view > 1.0]
    assert float(positive.sum()) == 14.0
    assert cuda.launches == {"_to_copy": 1, "gt": 1, "index": 1, "sum": 1, "_local_scalar_dense": 1}
    causes = sorted(place.rpartition(" ")[2] for place in cuda.waits)
    assert causes == ["_local_scalar_dense", "device", "index"]
    assert all(place.startswith(HERE) for place in cuda.waits)
    view.cpu()
    assert cuda.moved == {TO_DEVICE: 24, TO_HOST: 24}


def test_gradients_are_those_of_the_host(cuda: Tally) -> None:
    host, there = pair()
    gradients = []
    for values in (host, there):
        leaf = values.clone().requires_grad_()
        result = (leaf.exp() @ values).index_select(0, torch.ones(1, device=values.device).long())
        (gradient,) = torch.autograd.grad(result.square().sum(), leaf)
        gradients.append(gradient)
    assert gradients[1].is_cuda
    assert torch.equal(gradients[0], gradients[1].cpu())


def test_threads_use_the_device(cuda: Tally) -> None:
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda n: float(torch.full((3,), n, device="cuda").sum()), range(4)))
    assert found == [0.0, 3.0, 6.0, 9.0]
    assert cuda.launches["sum"] == 4


def test_nothing_is_left_behind() -> None:
    available, run = torch.cuda.is_available(), torch.Tensor.to
    with simulated_cuda():
        assert torch.cuda.is_available()
        there = torch.ones(2, device="cuda")
    assert torch.cuda.is_available() == available and torch.Tensor.to is run
    assert type(torch.ones(2)) is Tensor
    with pytest.raises(RuntimeError, match="outside of the simulation"):
        there + 1.0
