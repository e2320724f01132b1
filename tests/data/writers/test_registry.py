"""Writers as the registry lists them: names, options, and files that read back."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import is_dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

import spmm_torch
from spmm_torch.config.schema import describe
from spmm_torch.data import BTF, load_btf
from spmm_torch.data.writers import WRITERS, Writer, writer_of
from spmm_torch.errors import ConfigError
from spmm_torch.geometry.directions import ring_directions

ALL = [pytest.param(writer, id=name) for name, writer in WRITERS.items()]
DIRECTIONS = ring_directions(((0.0, 1), (30.0, 2)))
# Imports the registry without the package around it, which imports torch itself.
WITHOUT_TORCH = """
import sys
from types import ModuleType
package = sys.modules["spmm_torch"] = ModuleType("spmm_torch")
package.__path__ = [sys.argv[1]]
from spmm_torch.data.writers import WRITERS
assert WRITERS
assert "torch" not in sys.modules
"""


@pytest.fixture(scope="module")
def btf() -> BTF:
    """Smooth values of 3 x 3 pairs and 5 x 4 texels, from 0.2 to 0.8."""
    values = np.linspace(0.2, 0.8, 9 * 20 * 3, dtype=np.float32).reshape(3, 3, 5, 4, 3)
    return BTF.from_values(values, DIRECTIONS, DIRECTIONS)


@pytest.mark.parametrize("writer", ALL)
def test_the_defaults_write_what_reads_back(tmp_path: Path, btf: BTF, writer: Writer) -> None:
    """Up to the 8 bits of a JPEG."""
    seen: list[tuple[int, int]] = []
    path = tmp_path / f"a{writer.suffix}"
    writer.write(path, btf, writer.settings(), lambda done, total: seen.append((done, total)))
    found = load_btf(path)
    torch.testing.assert_close(found.texels(), btf.texels(), atol=0.05, rtol=0.0)
    assert seen[-1][0] == seen[-1][1] > 0
    assert writer.unit in ("views", "texels")


@pytest.mark.parametrize("writer", ALL)
def test_settings_are_explained(writer: Writer) -> None:
    assert is_dataclass(writer.settings)
    assert all(row[2] for row in describe(writer.settings))
    assert writer.name.islower() and writer.title


@pytest.mark.parametrize("writer", ALL)
def test_the_suffix_tells_the_writer(writer: Writer) -> None:
    assert writer_of(f"out/a{writer.suffix}") is writer
    assert writer_of(f"A{writer.suffix.upper()}") is writer


def test_names_of_folders() -> None:
    assert writer_of("a/") is writer_of("a.npz/") is WRITERS["exr"]


def test_an_unknown_suffix_is_told() -> None:
    with pytest.raises(ConfigError, match=r"ends in \.tif, .* expected \.npz, .* or no suffix for"):
        writer_of("a.tif")


def test_listing_writers_needs_no_torch() -> None:
    folder = spmm_torch.__path__[0]
    subprocess.run([sys.executable, "-c", WITHOUT_TORCH, folder], check=True, timeout=60)
