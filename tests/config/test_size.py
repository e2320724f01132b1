"""Sizes of memory in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.config.size import parse_size
from spmm_torch.errors import ConfigError

GIB = 1 << 30


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("0", 0),
        ("123", 123),
        ("123B", 123),
        ("4GB", 4_000_000_000),
        ("4gb", 4_000_000_000),
        ("4 G", 4_000_000_000),
        (" 500 MB ", 500_000_000),
        ("2.5k", 2500),
        ("0.5T", 500_000_000_000),
        ("3GiB", 3 * GIB),
        ("1.5 mib", 3 << 19),
        ("1Ki", 1024),
        ("2tib", 2 << 40),
    ],
)
def test_sizes(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize(
    "text", ["", "GB", "-4GB", "4XB", "4iB", "4GBB", "4 G B", "four", "4.GB", "1e9", "nan", "4,5GB"]
)
def test_no_sizes(text: str) -> None:
    with pytest.raises(ConfigError, match="is no size; expected a number with a unit") as error:
        parse_size(text)
    assert repr(text) in str(error.value)


@given(st.integers(0, 1 << 50))
def test_plain_numbers_are_bytes(size: int) -> None:
    assert parse_size(str(size)) == parse_size(f"{size} B") == size
