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


def faults(keep: str) -> int:
    """Pages that the system fills when 64 MB are taken four times more."""
    program = TAKE_AGAIN.format(keep=keep)
    return int(subprocess.check_output([sys.executable, "-c", program], text=True))


@pytest.mark.skipif(sys.platform != "linux", reason="the C library is another one")
def test_freed_memory_is_taken_again() -> None:
    assert faults("keep_freed_memory()") < faults("") // 4


def test_another_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from spmm_torch.runtime.allocator import keep_freed_memory

    for platform in ("darwin", "win32"):
        monkeypatch.setattr(sys, "platform", platform)
        monkeypatch.setattr("ctypes.CDLL", lambda *_: pytest.fail("it was loaded"))
        keep_freed_memory()
