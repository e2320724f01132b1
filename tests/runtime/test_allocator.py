"""Blocks that are freed and taken again, in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

TAKE_AGAIN = """
import ctypes, resource
from spmm_torch.runtime.allocator import keep_freed_memory
{keep}
SIZE = 1 << 26
library = ctypes.CDLL(None)
library.malloc.restype, library.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
library.free.argtypes = [ctypes.c_void_p]

def take():
    block = library.malloc(SIZE)
    ctypes.memset(block, 1, SIZE)
    library.free(block)

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

take()
before = faults()
for _ in range(4):
    take()
print(faults() - before)
"""


GIVE_BACK = """
import ctypes, re
from spmm_torch.runtime.allocator import give_back_freed_memory, keep_freed_memory
keep_freed_memory()
library = ctypes.CDLL(None)
library.malloc.restype, library.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
library.free.argtypes = [ctypes.c_void_p]

def held():
    return int(re.search(r"VmRSS:\\s+(\\d+)", open("/proc/self/status").read()).group(1))

block, last = library.malloc(1 << 26), library.malloc(1 << 20)
ctypes.memset(block, 1, 1 << 26)
library.free(block)
before = held()
give_back_freed_memory()
print(before - held())
"""


def printed(program: str) -> int:
    """The number that a program prints."""
    return int(subprocess.check_output([sys.executable, "-c", program], text=True))


def faults(keep: str) -> int:
    """Pages that the system fills when 64 MB are taken four times more."""
    return printed(TAKE_AGAIN.format(keep=keep))


@pytest.mark.skipif(sys.platform != "linux", reason="the C library is another one")
def test_freed_memory_is_taken_again() -> None:
    assert faults("keep_freed_memory()") < faults("") // 4


@pytest.mark.skipif(sys.platform != "linux", reason="the C library is another one")
def test_kept_memory_is_given_back() -> None:
    assert printed(GIVE_BACK) > 60_000  # kB


def test_another_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from spmm_torch.runtime.allocator import give_back_freed_memory, keep_freed_memory

    for platform in ("darwin", "win32"):
        monkeypatch.setattr(sys, "platform", platform)
        monkeypatch.setattr("ctypes.CDLL", lambda *_: pytest.fail("it was loaded"))
        keep_freed_memory()
        give_back_freed_memory()
