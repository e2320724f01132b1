"""Packages that the benchmark of a GPU cannot do without, and how the checkout is imported."""

from __future__ import annotations

import sys
from importlib.util import find_spec

# Modules, and what pip calls them. torch brings filelock, jinja2 and markupsafe along.
REQUIRED = {
    "torch": "torch",
    "numpy": "numpy",
    "scipy": "scipy",
    "yaml": "pyyaml",
    "safetensors": "safetensors",
    "tqdm": "tqdm",
    "PIL": "pillow",
    "filelock": "filelock",
    "jinja2": "jinja2",
    "markupsafe": "markupsafe",
}
TESTING = {"pytest": "pytest", "hypothesis": "hypothesis"}
OLDEST_PYTHON, OLDEST_TORCH = (3, 11), (2, 9)


def absent(packages: dict[str, str]) -> list[str]:
    """Those of some packages that are not installed, as pip calls them."""
    return [name for module, name in packages.items() if find_spec(module) is None]


def missing(device: str) -> str | None:
    """What this machine lacks, in one line; None: nothing."""
    if sys.version_info < OLDEST_PYTHON:
        return f"Python is {sys.version.split()[0]}; expected 3.11 or later."
    if names := absent(REQUIRED):
        return f"packages are missing: {' '.join(names)}; install them with pip."
    import torch

    import_checkout()
    version = tuple(int(part) for part in torch.__version__.split(".")[:2])
    if version < OLDEST_TORCH:
        return f"torch is {torch.__version__}; expected 2.9 or later."
    if device == "cuda" and not torch.cuda.is_available():
        return "torch sees no GPU here; --device cpu is a dry run."
    return None


def import_checkout() -> None:
    """Makes `spmm_torch.cli`, `.configs` and `.viz` known where the package is not installed."""
    import spmm_torch
    from tests.locations import ROOT

    if find_spec("spmm_torch.configs") is None:
        spmm_torch.__path__.append(str(ROOT))
