"""Files that are cut, bent or forged: a clear error or a valid read, and never much memory."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spmm_torch.data import ubo2014
from spmm_torch.data.ubo2014.header import VARIANTS
from spmm_torch.errors import DataError
from tests.data.ubo2014.independent_reader import load, sections
from tests.data.ubo2014.planted import planted

# What reading a file of 2 KB may take, Python and NumPy together.
MEMORY = 4 << 20
CODES = np.arange(6, dtype=np.uint16).reshape(2, 3)


@pytest.fixture
def traced() -> Iterator[None]:
    """Memory is watched during the whole test."""
    tracemalloc.start()
    yield
    tracemalloc.stop()


@contextmanager
def little_memory() -> Iterator[None]:
    """Fails if more than MEMORY is allocated at any time inside, where it is watched."""
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    yield
    assert tracemalloc.get_traced_memory()[1] - before < MEMORY


def file_sections(variant: str) -> dict[str, bytes]:
    """Every kind of field that a variant can have."""
    return sections(
        **planted(variant),
        rotations=np.arange(18.0).reshape(2, 3, 3),
        height_map=CODES,
        colour_model=11,
        reduced=1,
    )


def outcome(path: Path, content: bytes) -> DataError | None:
    """Reads a file to its last value; anything but success or a DataError is raised."""
    path.write_bytes(content)
    try:
        with little_memory():
            values = ubo2014.read(path).load().texels()
    except DataError as error:
        message = str(error)
        assert str(path) in message
        assert message.endswith(".") and "\n" not in message
        return error
    assert bool((values >= 0).all()) and bool(values.isfinite().all())
    return None


@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize("variant", VARIANTS)
def test_cut_at_every_border_of_a_field(tmp_path: Path, variant: str) -> None:
    parts = file_sections(variant)
    content = b"".join(parts.values())
    assert outcome(tmp_path / "a.btf", content) is None
    borders = np.cumsum([0, *map(len, parts.values())])
    cuts = {int(b) + step for b in borders for step in (-1, 0, 1)} & set(range(len(content)))
    for cut in sorted(cuts):
        error = outcome(tmp_path / "a.btf", content[:cut])
        assert error is not None
        if cut > len(parts["magic"]):
            assert "ends early" in str(error), cut


@pytest.mark.parametrize("variant", VARIANTS)
def test_bytes_after_the_end(tmp_path: Path, variant: str) -> None:
    content = b"".join(file_sections(variant).values())
    error = outcome(tmp_path / "a.btf", content + b"\0")
    assert f"goes on for 1 bytes after its last factor at byte {len(content)}" in str(error)


def u32(value: int) -> bytes:
    return struct.pack("<I", value)


def floats(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}f", *values)


WRONG_FIELDS = [
    ("size", u32(7), "gives its size as 7"),
    ("size", u32(2**32 - 1), "gives its size as 4294967295"),
    ("version", u32(1), "gives its size as"),
    ("xml length", u32(2**32 - 1), "of 4294967295 bytes are left for the XML"),
    ("channel count", u32(2), "has 2 channels"),
    ("channel count", u32(2**32 - 1), "has 4294967295 channels"),
    ("name length R", u32(2**31), "left for a channel's name"),
    ("view count", u32(0), "has 0 views"),
    ("view count", u32(2**32 - 1), "has 4294967295 views"),
    ("view count", u32(2000), "left for the list of views and lights"),
    ("light count 0", u32(0), "has 0 lights of view 0"),
    ("light count 0", u32(2**32 - 1), "has 4294967295 lights of view 0"),
    ("light count 0", u32(2048), "left for the list of views and lights"),
    ("light count 1", u32(2), "has 2 lights under view 1"),
    ("view 1", floats(np.nan, 0), "has view 1 at polar angle nan"),
    ("view 1", floats(1, np.inf), "has view 1 at polar angle 1, azimuth inf"),
    ("view 1", floats(-0.1, 0), "polar one from 0 to pi/2"),
    ("view 1", floats(1.6, 0), "polar one from 0 to pi/2"),
    ("view 1", floats(0, 2), "the same direction twice"),
    ("lights 0", floats(0, 0, 1, 1, 2, 2), "has light 2 at polar angle 2"),
    ("lights 1", floats(0, 0, np.nan, 1, 1, 2), "has another light 1 under view 1"),
    ("lights 1", floats(0, 0, 0.5236, 1.55, 1.309, 6.02), "has another light 1 under view 1"),
    ("width", u32(0), "has 0 columns of the pictures"),
    ("width", u32(5), "6 rows and 20 columns at byte"),
    ("height", u32(2**32 - 1), "17179869180 and 6, as the 2 views, 3 lights and 4 x 4294967295"),
    ("rotation count", u32(2**32 - 1), "left for the rotations"),
    ("colour model", u32(2), "has colour model 2"),
    ("scalar 0", b"\3", "holds numbers of 3 bytes"),
    ("scalar 1", b"\2", "numbers of 2 bytes for channel 'G'"),
    ("components 0", u32(0), "has 0 components"),
    ("components 0", u32(2**32 - 1), "left for the singular values"),
    ("components 1", u32(40), "left for"),
    ("rows 2", u32(7), "has factors for 7 rows and 20 columns"),
    ("columns 2", u32(2**32 - 1), "has factors for 6 rows and 4294967295 columns"),
]


@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize(("name", "content", "message"), WRONG_FIELDS)
def test_wrong_field(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    parts = file_sections("DFMF08FC")
    assert len(content) == len(parts[name])
    error = outcome(tmp_path / "a.btf", b"".join((parts | {name: content}).values()))
    assert message in str(error)


WRONG_FIELDS_OF_FMF = [
    ("extension", b"\3", "has extension version 3"),
    ("map width", u32(2**32 - 1), "left for the height map"),
    ("map height", u32(1), "at byte"),
    ("scalar 0", b"\0", "holds numbers of 0 bytes"),
    ("components 0 0", u32(0), "has 0 components"),
    ("components 0 0", u32(2), "goes on for"),
    ("components 0", u32(2), "goes on for"),
    ("rows 0", u32(6), "expected 18 and 20, or 60 and 6,"),
]


@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize(("name", "content", "message"), WRONG_FIELDS_OF_FMF)
def test_wrong_field_of_fmf(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    parts = file_sections("FMF12FCE")
    assert len(content) == len(parts[name])
    error = outcome(tmp_path / "a.btf", b"".join((parts | {name: content}).values()))
    assert message in str(error)


@pytest.mark.parametrize("name", ["components 0", "components 0 0"])
def test_the_smaller_number_of_components_counts(tmp_path: Path, name: str) -> None:
    parts = file_sections("FMF06FC") | {name: u32(2**32 - 1)}
    assert outcome(tmp_path / "a.btf", b"".join(parts.values())) is None


def test_the_byte_in_a_message_is_where_the_field_lies(tmp_path: Path) -> None:
    parts = file_sections("DFMF08FC")
    names = list(parts)
    for name, content, _ in WRONG_FIELDS:
        if name in ("version", "components 1", "width", "height"):  # found out later in the file
            continue
        error = str(outcome(tmp_path / "a.btf", b"".join((parts | {name: content}).values())))
        if "ends early" in error or "twice" in error:
            continue
        start = sum(len(parts[other]) for other in names[: names.index(name)])
        offset = int(error.partition(" at byte ")[2].partition(";")[0])
        first = start - 4 if name == "columns 2" else start  # after rows, which are named with it
        assert first <= offset < start + len(content), name


def run_flips(path: Path, variant: str, all_of_it: bool, examples: int) -> None:
    """Change up to three bytes at a time; what is still accepted the second loader accepts, too.

    Args:
        all_of_it: factors included; else only the fields before and between them.
    """
    parts = file_sections(variant)
    content = b"".join(parts.values())
    ends = np.cumsum(list(map(len, parts.values())))
    places = [
        place
        for (name, part), end in zip(parts.items(), ends, strict=True)
        if all_of_it or not name.startswith(("left", "right", "singular"))
        for place in range(end - len(part), end)
    ]

    @settings(max_examples=examples, suppress_health_check=list(HealthCheck))
    @given(st.dictionaries(st.sampled_from(places), st.integers(1, 255), min_size=1, max_size=3))
    def run(flips: dict[int, int]) -> None:
        changed = bytearray(content)
        for place, mask in flips.items():
            changed[place] ^= mask
        if outcome(path, bytes(changed)) is None:
            load(bytes(changed))

    run()


@pytest.mark.parametrize("all_of_it", [False, True])
@pytest.mark.parametrize("variant", VARIANTS)
def test_flipped_bytes(tmp_path: Path, variant: str, all_of_it: bool) -> None:
    run_flips(tmp_path / "a.btf", variant, all_of_it, examples=100)


@pytest.mark.slow
@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize("all_of_it", [False, True])
@pytest.mark.parametrize("variant", VARIANTS)
def test_thousands_of_flipped_bytes(tmp_path: Path, variant: str, all_of_it: bool) -> None:
    run_flips(tmp_path / "a.btf", variant, all_of_it, examples=500)
