"""docs/architecture.md names the floors, rooms and functions that there are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.markdown import table
from tests.locations import DOCS, ROOT
from tests.test_import_floors import FLOORS

PAGE = DOCS / "architecture.md"
TOP = frozenset({"cli", "configs", "docs", "tests", "viz"})


def code_spans(cell: str) -> list[str]:
    """What stands in backticks."""
    return cell.split("`")[1::2]


def test_the_floors_are_those_of_the_test() -> None:
    rows = table(PAGE, "floor", "units", "who may not know whom")
    assert [int(row[0]) for row in rows] == list(range(len(FLOORS), 0, -1))
    assert [frozenset(code_spans(row[1])) for row in reversed(rows)] == list(FLOORS)


def test_every_room_has_its_line() -> None:
    listed = [Path(code_spans(row[0])[0]) for row in table(PAGE, "room", "what is in it")]
    package = [path.parent.relative_to(ROOT) for path in (ROOT / "spmm_torch").glob("*/*.py")]
    assert set(listed) == {*package, *map(Path, TOP)}
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("row", table(PAGE, "stage", "paper", "where", "function"), ids=str)
def test_every_function_is_where_the_page_says(row: list[str]) -> None:
    place, name = ROOT / code_spans(row[2])[0], code_spans(row[3])[0]
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    defined = re.compile(rf"^(?:def|class) {name}\b|^{name}\b.*=", re.MULTILINE)
    assert any(defined.search(path.read_text(encoding="utf-8")) for path in files)
