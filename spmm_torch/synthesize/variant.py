"""The variant of Mitsuba that works on this machine, found in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from typing import Any

from ..config.synthesis import FAST, PLAIN, VARIANTS
from ..errors import ConfigError
from ..runtime.progress import Progress

# A render that aborts its process if LLVM is too old for the processor.
PROBE = """
import sys
import mitsuba
mitsuba.set_variant(sys.argv[1])
ball = {"type": "sphere", "material": {"type": "principled"}}
film = {"type": "hdrfilm", "width": 1, "height": 1}
camera = {"type": "orthographic", "film": film, "sampler": {"type": "independent"}}
parts = {"ball": ball, "sun": {"type": "directional"}, "camera": camera}
scene = mitsuba.load_dict({"type": "scene", "integrator": {"type": "path"}} | parts)
list(mitsuba.render(scene, spp=1).array)
"""
PROBE_SECONDS = 120


def load_mitsuba(variant: str, threads: int, progress: Progress) -> Any:
    """The module `mitsuba`, set to a variant that works on this machine.

    Args:
        variant: one of VARIANTS; "auto" is the fastest one that works.
        threads: number of threads; 0: one for each core.
        progress: receiver of a line if "auto" is the slow variant.

    Raises:
        ConfigError: Mitsuba is not installed, or the variant is unknown or does not work.
    """
    if variant not in VARIANTS:
        raise ConfigError(
            f"--variant of spmm synthesize is {variant!r}; expected one of {', '.join(VARIANTS)}."
        )
    if find_spec("mitsuba") is None:
        raise ConfigError(
            "spmm synthesize needs Mitsuba 3, which is not installed; get it by "
            "pip install 'spmm_torch[mitsuba]'."
        )
    chosen = _choose(variant, progress)
    import mitsuba

    mitsuba.set_variant(chosen)
    import drjit

    if threads:
        drjit.set_thread_count(threads)
    return mitsuba


def _choose(variant: str, progress: Progress) -> str:
    """The name of a variant that works, instead of "auto"."""
    if variant == "auto":
        if works(FAST):
            return FAST
        progress.say(
            f"Mitsuba finds no usable LLVM (a libLLVM of 19 or newer; the environment variable "
            f"DRJIT_LIBLLVM_PATH can name it), so {PLAIN} renders, two to three times slower."
        )
        return PLAIN
    if not works(variant):
        raise ConfigError(
            f"--variant of spmm synthesize is {variant}, which does not work on this machine; "
            f"use --variant auto."
        )
    return variant


@cache
def works(variant: str) -> bool:
    """Whether a variant renders on this machine; tried in its own process, which may abort."""
    if variant == PLAIN:
        return True
    try:
        probe = subprocess.run(
            [sys.executable, "-c", PROBE, variant], capture_output=True, timeout=PROBE_SECONDS
        )
    except subprocess.TimeoutExpired:
        return False
    return probe.returncode == 0
