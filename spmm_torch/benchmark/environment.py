"""The environment of a benchmark, by which its figures can be judged."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from ..report.summary import device_name, versions

CPU_FACTS, CPU_MODEL = Path("/proc/cpuinfo"), "model name"
# Peers and tools whose versions change the figures, where they are installed.
PACKAGES = ("scikit-learn", "flip-evaluator")
GIT_SECONDS = 10


def environment(device: torch.device) -> dict[str, Any]:
    """Processor, threads, versions and commit."""
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "device": device_name(device),
        "system": platform.platform(),
        "versions": {**versions(), **_installed()},
        "commit": commit(Path(__file__).parent),
    }


def cpu_model() -> str:
    """The name of the processor."""
    try:
        for line in CPU_FACTS.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == CPU_MODEL:
                return value.strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def commit(folder: Path) -> str | None:
    """The commit of a checkout, with `+` if files changed since; None outside of a checkout."""

    def git(*arguments: str) -> str:
        command = ("git", "-C", str(folder), *arguments)
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=GIT_SECONDS
        )
        return done.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _installed() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
