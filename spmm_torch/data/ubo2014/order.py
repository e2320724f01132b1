"""The order of the rows of pictures in a UBO2014 file, which only files of this package state.

The format has no field for it, and readers disagree: the library of the format's authors takes the
top row to come first, `btf.hh` and BTF_extractor the bottom row. A processing instruction behind
the XML of the header, which no reader looks into, tells the order of a file that was written here.
"""

from __future__ import annotations

import re

# Orders: the top row first, or the bottom row.
TOP, BOTTOM = "top", "bottom"
ORDERS = (TOP, BOTTOM)
MARK = re.compile(r'<\?spmm rows="(\w+)"\?>$')


def with_mark(xml: str, rows: str) -> str:
    """The XML of a header with the mark of an order."""
    return f'{xml}<?spmm rows="{rows}"?>'


def split_mark(xml: str) -> tuple[str, str | None]:
    """The XML of a header without its mark, and the order that it states; None without a mark."""
    found = MARK.search(xml)
    if found is None or found[1] not in ORDERS:
        return xml, None
    return xml[: found.start()], found[1]
