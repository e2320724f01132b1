"""The Markdown files of the repository, and what stands in them: code, tables, code spans."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from tests.locations import ROOT

# Folders that are made, not written.
MADE = frozenset({"build", "dist", "runs", "node_modules"})
FENCE = re.compile(r"^ *```(\S*)\s*$")


@dataclass(frozen=True)
class Block:
    """A fenced block of a document.

    Attributes:
        language: the word behind the fence; empty for none.
        text: its lines.
        line: number of its first line, from 1.
    """

    language: str
    text: str
    line: int


def files(*suffixes: str) -> list[Path]:
    """All files of the repository with one of some suffixes; hidden folders and builds left out."""
    found: list[Path] = []
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if not name.startswith(".") and name not in MADE]
        found += [Path(folder) / name for name in names if name.endswith(suffixes)]
    return sorted(found)


def documents() -> list[Path]:
    """All Markdown files of the repository."""
    return files(".md")


def name_of(path: Path) -> str:
    """The path of a file within the repository."""
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path, *languages: str) -> list[Block]:
    """The fenced blocks of a document, of some languages or of all."""
    found, language, lines, start = [], None, [], 0
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fence = FENCE.match(line)
        if fence and language is None:
            language, lines, start = fence[1], [], number + 1
        elif fence:
            found.append(Block(language, "".join(f"{line}\n" for line in lines), start))
            language = None
        else:
            lines.append(line)
    return [block for block in found if not languages or block.language in languages]


def prose(path: Path) -> list[tuple[int, str]]:
    """(number, text) of each line outside of fenced blocks."""
    outside, found = True, []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if FENCE.match(line):
            outside = not outside
        elif outside:
            found.append((number, line))
    return found


def table(path: Path, *header: str) -> list[list[str]]:
    """The cells of the rows of the table with this header.

    Raises:
        LookupError: no such table.
    """
    rows = [line for _, line in prose(path)]
    cells = [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows]
    if list(header) not in cells:
        raise LookupError(f"{name_of(path)} has no table {header}")
    first = cells.index(list(header)) + 2
    length = next((n for n, row in enumerate(rows[first:]) if not row.startswith("|")), None)
    return cells[first:][:length]


def patched(text: str, diff: str) -> str:
    """Text with the lines of a diff added; its other lines tell where."""
    lines = diff.splitlines()
    before = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("+"))
    after = "".join(f"{line[1:]}\n" for line in lines)
    assert text.count(before) == 1, f"the place of\n{diff}is not found once"
    return text.replace(before, after)
