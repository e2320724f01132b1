"""Which variables of the environment are those of torchrun."""

from __future__ import annotations

import socket
from datetime import timedelta

import pytest
import torch

from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.runtime import ranks
from spmm_torch.runtime.device import local_device, resolve_device
from spmm_torch.runtime.ranks import ALONE, joined_ranks, launched, local_count, speaks

TORCHRUN = {
    "RANK": "2",
    "WORLD_SIZE": "4",
    "LOCAL_RANK": "1",
    "LOCAL_WORLD_SIZE": "2",
    "MASTER_ADDR": "localhost",
    "MASTER_PORT": "29500",
}


@pytest.fixture(autouse=True)
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in TORCHRUN:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    "stray",
    [
        {},
        {"WORLD_SIZE": ""},
        {"WORLD_SIZE": "4"},
        {"WORLD_SIZE": "4", "RANK": "3"},
        {"WORLD_SIZE": "four", "RANK": "0", "MASTER_ADDR": "here", "MASTER_PORT": "1"},
        {**TORCHRUN, "MASTER_ADDR": ""},
        {"RANK": "", "LOCAL_RANK": "", "LOCAL_WORLD_SIZE": ""},
        {"RANK": "-1"},
    ],
)
def test_stray_variables_leave_a_process_alone(
    stray: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in stray.items():
        monkeypatch.setenv(name, value)
    with joined_ranks(torch.device("cpu")) as ranks:
        assert ranks is ALONE
    assert local_count() == 1 and speaks() and local_device("auto") == "auto"


def test_those_of_torchrun_count(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in TORCHRUN.items():
        monkeypatch.setenv(name, value)
    assert (launched("WORLD_SIZE", 1), launched("RANK", 0), local_count()) == (4, 2, 2)
    assert not speaks()


@pytest.mark.parametrize("name", ["cpu:3", "cpu:1"])
def test_there_is_one_cpu(name: str) -> None:
    with pytest.raises(ConfigError, match=f"device is '{name}'; expected auto, cpu, cuda or"):
        resolve_device(name)
    assert resolve_device("cpu:0").type == "cpu"


@pytest.mark.parametrize("fault", ["rank", "port", "host", "alone"])
def test_processes_that_cannot_meet_are_told_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        given = {
            "MASTER_ADDR": "no.host.invalid" if fault == "host" else "127.0.0.1",
            "MASTER_PORT": str(other.getsockname()[1]),
            "RANK": "5" if fault == "rank" else "0",
            "WORLD_SIZE": "2",
        }
        if fault == "alone":
            other.close()
        for name, value in given.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(ranks, "MEETING", timedelta(seconds=1))
        with (
            pytest.raises(SPMMError, match=r"cannot meet at [\w.]+:\d+ \(.*torchrun") as caught,
            joined_ranks(torch.device("cpu")),
        ):
            pass
    assert "\n" not in str(caught.value)
