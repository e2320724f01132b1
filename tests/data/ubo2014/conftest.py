"""A small file of each variant, made by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.data.ubo2014.independent_reader import sections
from tests.data.ubo2014.planted import planted

Sections = dict[str, bytes]


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., Path]:
    """Writes a planted file: `make("FMF06FC", scalar=2, patch={"width": b"...."})`."""

    def write(
        variant: str = "DFMF08FC", *, patch: Sections | None = None, **changes: object
    ) -> Path:
        parts = sections(**(planted(variant) | changes))
        assert set(patch or {}) <= set(parts)
        path = tmp_path / "planted.btf"
        path.write_bytes(b"".join((parts | (patch or {})).values()))
        return path

    return write
