"""The device of a process, and how exactly it computes."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.device import full_precision, local_device

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
    for rank, device in enumerate(["cuda:0", "cuda:1", "cuda:0"]):
        monkeypatch.setenv("LOCAL_RANK", f"{rank}")
        assert [local_device(name) for name in NAMES] == [device, "cpu", device, "cuda:1"]


@pytest.mark.parametrize("allowed", [False, True])
def test_full_precision_is_for_a_while(allowed: bool) -> None:
    matmul = torch.backends.cuda.matmul
    before = matmul.allow_tf32
    try:
        matmul.allow_tf32 = allowed
        with pytest.raises(RuntimeError, match="bug"), full_precision():
            assert not matmul.allow_tf32
            raise RuntimeError("bug")
        assert matmul.allow_tf32 == allowed
    finally:
        matmul.allow_tf32 = before
