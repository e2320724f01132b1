"""The device of a process, and how exactly it computes."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.runtime.device import full_precision, local_device

NAMES = ("auto", "cpu", "cuda", "cuda:1")


def test_without_torchrun_the_setting_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LOCAL_RANK", raising=False)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert tuple(map(local_device, NAMES)) == NAMES


def test_without_a_gpu_the_setting_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCAL_RANK", "1")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert tuple(map(local_device, NAMES)) == NAMES


def test_each_rank_has_its_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranks beyond the number of GPUs share them."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    torchrun = {"RANK": "0", "WORLD_SIZE": "3", "MASTER_ADDR": "here", "MASTER_PORT": "1"}
    for name, value in torchrun.items():
        monkeypatch.setenv(name, value)
    for rank, device in enumerate(["cuda:0", "cuda:1", "cuda:0"]):
        monkeypatch.setenv("LOCAL_RANK", f"{rank}")
        assert [local_device(name) for name in NAMES] == [device, "cpu", device, "cuda:1"]


def bits(precision: str) -> tuple[str, str]:
    """How products of float32 are computed on GPU and CPU, if the process asks for `precision`."""
    torch.set_float32_matmul_precision(precision)
    return torch.backends.cuda.matmul.fp32_precision, torch.backends.mkldnn.matmul.fp32_precision


@pytest.mark.parametrize("precision", ["highest", "high", "medium"])
def test_full_precision_is_for_a_while(precision: str) -> None:
    products = (torch.backends.cuda.matmul, torch.backends.mkldnn.matmul)
    try:
        asked = bits(precision)
        with pytest.raises(RuntimeError, match="bug"), full_precision():
            assert all(product.fp32_precision == "ieee" for product in products)
            raise RuntimeError("bug")
        assert tuple(product.fp32_precision for product in products) == asked
        assert torch.get_float32_matmul_precision() == precision
    finally:
        torch.set_float32_matmul_precision("highest")


def test_autocast_does_not_reach_into_it() -> None:
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.bfloat16
        with full_precision():
            assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.float32
