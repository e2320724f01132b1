"""Sizes, what is free, how it is shared out, and scratch space on disk."""

from __future__ import annotations

import errno
import mmap
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.errors import ConfigError, OutputError
from spmm_torch.runtime import memory
from spmm_torch.runtime.memory import (
    Budget,
    blocks_of,
    free_memory,
    held_memory,
    scratch,
    slices,
)

CPU = torch.device("cpu")
MIB, GIB = 1 << 20, 1 << 30


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Files of a system with 8 GiB available; groups `v2` and `v1` are not there yet."""
    (tmp_path / "meminfo").write_text(
        f"MemTotal: 99999999 kB\nMemFree: 1 kB\nMemAvailable:   {8 * GIB // 1024} kB\n"
    )
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    groups = tuple(
        (tmp_path / folder, *names)
        for folder, (_, *names) in zip(("v2", "v1"), memory.CGROUPS, strict=True)
    )
    monkeypatch.setattr(memory, "CGROUPS", groups)
    return tmp_path


def write_group(folder: Path, version: int, limit: object, used: int, details: str) -> None:
    folder.mkdir()
    names = {
        1: ("memory.limit_in_bytes", "memory.usage_in_bytes"),
        2: ("memory.max", "memory.current"),
    }
    for name, number in zip(names[version], (limit, used), strict=True):
        (folder / name).write_text(f"{number}\n")
    if details:
        (folder / "memory.stat").write_text(details)


def test_free_memory_without_a_container(system: Path) -> None:
    assert free_memory() == 8 * GIB


@pytest.mark.parametrize(
    ("version", "limit", "details", "expected"),
    [
        (2, "max", "", 8 * GIB),
        (2, 4 * GIB, "", GIB),
        (2, 4 * GIB, f"anon 5\ninactive_anon 7\ninactive_file {2 * GIB}\nactive_file 9\n", 3 * GIB),
        (2, 4 * GIB, "anon 5\n", GIB),
        (2, 4 * GIB, "inactive_file much\n", GIB),
        (2, 2 * GIB, "", 0),  # over its limit
        (2, 64 * GIB, "", 8 * GIB),
        (2, "nonsense", "", 8 * GIB),
        (1, 9223372036854771712, "", 8 * GIB),
        (1, 5 * GIB, f"inactive_file 1\ntotal_inactive_file {GIB}\n", 3 * GIB),
    ],
)
def test_free_memory_in_a_container(
    system: Path, version: int, limit: object, details: str, expected: int
) -> None:
    write_group(system / f"v{version}", version, limit, 3 * GIB, details)
    assert free_memory() == expected


def test_the_tightest_limit_counts(system: Path) -> None:
    write_group(system / "v2", 2, 6 * GIB, GIB, "")
    write_group(system / "v1", 1, 4 * GIB, GIB, "")
    assert free_memory() == 3 * GIB


@pytest.mark.parametrize("content", [None, "", "MemTotal: 5 kB\n", "MemAvailable: lots\n"])
def test_free_memory_where_the_system_tells_little(system: Path, content: str | None) -> None:
    (system / "meminfo").unlink()
    if content is not None:
        (system / "meminfo").write_text(content)
    assert free_memory() == os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def test_this_machine() -> None:
    assert 0 < free_memory() <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    before = held_memory()
    with mmap.mmap(-1, 64 * MIB) as held:  # not what an allocator may have kept
        held[:: mmap.PAGESIZE] = b"1" * (64 * MIB // mmap.PAGESIZE)
        assert held_memory() - before > 32 * MIB


def test_budget_of_a_limit() -> None:
    budget = Budget.build(4 * GIB).needing(GIB)
    assert (budget.total, budget.working, budget.spare) == (4 * GIB, GIB, 3 * GIB)
    assert Budget.build(GIB).needing(GIB).spare == 0


@pytest.mark.parametrize("limit", [0, GIB - 1])
def test_limit_below_what_any_fit_takes(limit: int) -> None:
    with pytest.raises(ConfigError, match="^--max-memory is .* but this input needs 1.07 GB"):
        Budget.build(limit).needing(GIB)


def test_budget_of_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_memory", lambda: 8 * GIB)
    assert Budget.build().needing(GIB) == Budget(4 * GIB, working=GIB)
    assert Budget.build(processes=4).needing(GIB) == Budget(GIB, working=GIB)
    assert Budget.build().needing(5 * GIB).spare == 0  # tried nevertheless


@given(st.integers(0, 50), st.integers(1, 60))
def test_slices_cover_everything_once(count: int, size: int) -> None:
    parts = list(slices(count, size))
    assert [i for part in parts for i in range(count)[part]] == list(range(count))
    assert all(part.stop - part.start == size for part in parts[:-1])
    assert all(0 < part.stop - part.start <= size for part in parts)


@pytest.mark.parametrize("shape", [(3, 4, 5), (1,), (0, 7), ()])
def test_scratch_in_a_file_is_as_good_as_memory(shape: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    numbers = torch.randn(shape, generator=generator)
    for in_memory in (True, False):
        tensor = scratch(shape, in_memory, CPU)
        assert (tensor.shape, tensor.dtype, tensor.device) == (shape, torch.float32, CPU)
        assert tensor.is_contiguous()
        tensor.copy_(numbers)
        tensor += 1.0
        assert torch.equal(tensor, numbers + 1.0)
        assert torch.equal((tensor * tensor).sum(), ((numbers + 1.0) ** 2).sum())


def test_scratch_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    first, second = (scratch((1 << 18,), False, CPU) for _ in range(2))
    assert not list(tmp_path.iterdir())  # it ends with the process, even a killed one
    first.fill_(1.0)
    second.fill_(2.0)
    assert first.unique().tolist() == [1.0]  # each has its own


def test_scratch_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(memory.os, "posix_fallocate", full)
    with pytest.raises(OutputError, match="2.0 GB of scratch space .*No space left") as error:
        scratch((1000, 500, 1000), False, CPU)
    text = str(error.value)
    assert str(tmp_path) in text and "TMPDIR" in text and "--max-memory" in text
    assert "\n" not in text and not list(tmp_path.iterdir())


def test_scratch_in_a_folder_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "no"))
    with pytest.raises(OutputError, match="scratch space cannot be had in"):
        scratch((3,), False, CPU)


def test_peak_is_that_of_this_process_alone() -> None:
    """Whoever starts a process lends it its own peak for getrusage, but not for this."""
    code = (
        "from spmm_torch.runtime.memory import peak_resident_memory; print(peak_resident_memory())"
    )
    with mmap.mmap(-1, 2 * GIB) as held:
        held[:: mmap.PAGESIZE] = b"1" * (2 * GIB // mmap.PAGESIZE)
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert 0 < int(result.stdout) < GIB


@given(st.lists(st.integers(0, 9)), st.integers(1, 12))
def test_blocks_are_full_and_in_order(sizes: list[int], most: int) -> None:
    blocks = list(blocks_of(sizes, lambda size: size, most))
    assert [size for block in blocks for size in block] == sizes
    assert all(block and (len(block) == 1 or sum(block) <= most) for block in blocks)
    following = zip(blocks, blocks[1:], strict=False)
    assert all(sum(block) + after[0] > most for block, after in following)
