"""Finished stages are kept whole, read back as they were, and made anew where they are damaged."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.runtime.checkpoint import CONTENT, Checkpoint, content_hash, stage_generator
from spmm_torch.runtime.stopwatch import Stopwatch
from spmm_torch.runtime.tensor_file import pack

CPU = torch.device("cpu")
# The first 8 bytes of BLAKE2b of "0/cluster", without their highest bit.
SEED_OF_CLUSTER = 1767010012636049066
KINDS = (torch.float32, torch.float64, torch.int64, torch.int16, torch.uint8, torch.bool)


@dataclass(frozen=True)
class Numbers:
    """What a stage of these tests yields."""

    tensors: dict[str, Tensor]

    def to_tensors(self) -> dict[str, Tensor]:
        return self.tensors

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Numbers:
        return cls(tensors)


class Stage:
    """Computes, and counts how often it had to."""

    def __init__(self, watch: Stopwatch | None = None, stage: str = "search") -> None:
        self.calls = 0
        self.watch, self.stage = watch, stage
        generator = torch.Generator().manual_seed(0)
        draw = torch.rand(4, 3, generator=generator) * 100.0
        self.result = Numbers({str(kind): draw.to(kind) for kind in KINDS})

    def __call__(self) -> Numbers:
        self.calls += 1
        if self.watch is not None:
            with self.watch(self.stage):
                pass
        return self.result


def checkpoint(folder: Path | None, watch: Stopwatch | None = None) -> Checkpoint:
    return Checkpoint(watch or Stopwatch(CPU), folder)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def check_equal(found: Numbers, expected: Numbers) -> None:
    assert found.tensors.keys() == expected.tensors.keys()
    for name, tensor in expected.tensors.items():
        assert found.tensors[name].dtype == tensor.dtype
        assert torch.equal(found.tensors[name], tensor)


def test_computes_once(tmp_path: Path) -> None:
    stage = Stage()
    check_equal(checkpoint(tmp_path).once("a", Numbers, stage), stage.result)
    check_equal(checkpoint(tmp_path).once("a", Numbers, stage), stage.result)
    assert stage.calls == 1
    checkpoint(tmp_path).once("b", Numbers, stage)
    assert stage.calls == 2
    assert names(tmp_path) == ["a.safetensors", "b.safetensors"]


def test_keeps_nothing_without_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    stage = Stage()
    for _ in range(2):
        assert checkpoint(None).once("a", Numbers, stage) is stage.result
    assert stage.calls == 2
    assert names(tmp_path) == []


def test_seconds_outlast_the_process(tmp_path: Path) -> None:
    """Those of each stage alone, and together they are what the resumed run gains in total."""
    watch = Stopwatch(CPU)
    for stage in ("cluster", "search"):
        checkpoint(tmp_path, watch).once(stage, Numbers, Stage(watch, stage))
    again = Stopwatch(CPU)
    again.seconds = {"search": 1.0, "load": 2.0}
    for stage in ("cluster", "search"):
        checkpoint(tmp_path, again).once(stage, Numbers, Stage())
    assert again.seconds["cluster"] == watch.seconds["cluster"]
    assert again.seconds["search"] == 1.0 + watch.seconds["search"]
    assert again.seconds["load"] == 2.0
    assert again.seconds["total"] == pytest.approx(sum(watch.seconds.values()))


def test_seconds_of_a_stage_that_goes_on_outlast_the_process(tmp_path: Path) -> None:
    """Passes of the refit are kept one by one, within a stage that ends after them."""
    watch, again = Stopwatch(CPU), Stopwatch(CPU)
    with watch("total"), watch("refit"):
        checkpoint(tmp_path, watch).once("pass", Numbers, Stage(watch, "pass"))
    checkpoint(tmp_path, again).once("pass", Numbers, Stage())
    assert again.seconds["pass"] == watch.seconds["pass"]
    assert watch.seconds["pass"] <= again.seconds["refit"] <= watch.seconds["refit"]
    assert again.seconds["total"] == again.seconds["pass"] + again.seconds["refit"]


def test_a_file_that_a_kill_left_half_written_is_ignored(tmp_path: Path) -> None:
    unfinished = ".a.safetensors.1.tmp"
    (tmp_path / unfinished).write_bytes(b"half")
    stage = Stage()
    check_equal(checkpoint(tmp_path).once("a", Numbers, stage), stage.result)
    assert stage.calls == 1
    assert names(tmp_path) == [unfinished, "a.safetensors"]


@pytest.mark.parametrize("size", [0, 4, 100, -1])
def test_a_damaged_file_is_made_anew(tmp_path: Path, size: int) -> None:
    stage = Stage()
    checkpoint(tmp_path).once("a", Numbers, stage)
    path = tmp_path / "a.safetensors"
    content = path.read_bytes()
    path.write_bytes(content[:size])
    for _ in range(2):
        check_equal(checkpoint(tmp_path).once("a", Numbers, stage), stage.result)
    assert stage.calls == 2
    assert len(path.read_bytes()) == len(content)


@dataclass(frozen=True)
class Pair:
    """A result of two tensors of one length."""

    first: Tensor
    second: Tensor

    def to_tensors(self) -> dict[str, Tensor]:
        return {"first": self.first, "second": self.second}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Pair:
        torch.stack((tensors["first"], tensors["second"]))
        return cls(tensors["first"], tensors["second"])


UNUSABLE: dict[str, tuple[dict[str, Tensor], dict[str, str]]] = {
    "names of another release": ({"first": torch.ones(2)}, {"seconds": "{}"}),
    "another shape": ({"first": torch.ones(2), "second": torch.ones(3)}, {"seconds": "{}"}),
    "no seconds": ({"first": torch.ones(2), "second": torch.ones(2)}, {}),
    "half of the seconds": ({"first": torch.ones(2), "second": torch.ones(2)}, {"seconds": "{"}),
    "seconds of no stage": ({"first": torch.ones(2), "second": torch.ones(2)}, {"seconds": "7"}),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_what_cannot_be_used_is_made_anew_with_one_line(tmp_path: Path, case: str) -> None:
    tensors, metadata = UNUSABLE[case]
    facts = {"depends_on": "", CONTENT: content_hash("a", tensors), **metadata}
    (tmp_path / "a.safetensors").write_bytes(pack(tensors, facts))
    told: list[str] = []
    made = Pair(torch.zeros(1), torch.zeros(1))
    for _ in range(2):
        kept = Checkpoint(Stopwatch(CPU), tmp_path, say=told.append)
        assert torch.equal(kept.once("a", Pair, lambda: made).first, made.first)
    assert len(told) == 1 and told[0].startswith("a: what an earlier process kept cannot be used")


@pytest.mark.parametrize("case", ["a bit", "zeros", "another stage"])
def test_a_whole_file_of_other_values_is_made_anew(tmp_path: Path, case: str) -> None:
    """After a crash of the machine; the header of such a file says nothing of it."""
    for name, value in (("a", 1.0), ("b", 2.0)):
        made = Pair(torch.full((9,), value), torch.zeros(9))
        checkpoint(tmp_path).once(name, Pair, lambda made=made: made)
    path = tmp_path / "a.safetensors"
    content = path.read_bytes()
    if case == "another stage":
        path.write_bytes((tmp_path / "b.safetensors").read_bytes())
    else:
        end = bytes(60) if case == "zeros" else bytes([content[-60] ^ 1]) + content[-59:]
        path.write_bytes(content[:-60] + end)
    told: list[str] = []
    kept = Checkpoint(Stopwatch(CPU), tmp_path, say=told.append)
    anew = Pair(torch.full((9,), 3.0), torch.zeros(9))
    assert kept.once("a", Pair, lambda: anew) is anew
    assert len(told) == 1 and "it holds other values than were written" in told[0]


def test_a_stage_of_something_else_is_made_anew(tmp_path: Path) -> None:
    told: list[str] = []
    for key, calls in (("this", 1), ("this", 0), ("other", 1)):
        stage = Stage()
        Checkpoint(Stopwatch(CPU), tmp_path, depends_on=key, say=told.append).once(
            "a", Numbers, stage
        )
        assert stage.calls == calls
    assert len(told) == 1 and "of another input, or with other settings" in told[0]


def test_tensors_that_share_memory(tmp_path: Path) -> None:
    both = torch.arange(6.0).view(2, 3)
    shared = Numbers({"all": both, "column": both[:, 1], "wide": both[:1].expand(4, 3)})
    checkpoint(tmp_path).once("a", Numbers, lambda: shared)
    found = checkpoint(tmp_path).once("a", Numbers, lambda: pytest.fail("it is there"))
    check_equal(found, shared)


def test_full_disk_spares_what_is_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoint(tmp_path).once("a", Numbers, Stage())
    before = (tmp_path / "a.safetensors").read_bytes()
    whole = Path.write_bytes

    def half(path: Path, content: bytes) -> int:
        whole(path, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(OSError, match="No space left"):
        checkpoint(tmp_path).once("b", Numbers, Stage())
    assert names(tmp_path) == ["a.safetensors"]
    assert (tmp_path / "a.safetensors").read_bytes() == before


def test_a_stage_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def fail() -> Numbers:
        raise RuntimeError("bug")

    with pytest.raises(RuntimeError, match="bug"):
        checkpoint(tmp_path).once("a", Numbers, fail)
    assert names(tmp_path) == []


SEEDS = st.integers(0, 2**63 - 1)
STAGES = st.sampled_from(["cluster", "sample", "search", "1", ""])


@given(st.tuples(SEEDS, STAGES), st.tuples(SEEDS, STAGES))
def test_each_seed_and_stage_has_its_own_randomness(
    one: tuple[int, str], other: tuple[int, str]
) -> None:
    first, second = stage_generator(*one), stage_generator(*other)
    assert (first.initial_seed() == second.initial_seed()) == (one == other)


def test_randomness_is_the_same_in_every_process() -> None:
    """A run that was begun before an update of Python goes on with the same numbers."""
    assert stage_generator(0, "cluster").initial_seed() == SEED_OF_CLUSTER
    draws = [torch.rand(8, generator=stage_generator(7, "search")) for _ in range(2)]
    assert torch.equal(*draws)
