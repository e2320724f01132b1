"""What a zip or folder holds beside the files that are read of it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from .file_names import parse_angles
from .named_pictures import is_picture
from .pictures import beside_inner_zip

# Suffixes of files that are a BTF by themselves or hold one, and that a zip or folder may hold.
PACKED = (
    *(".zip", ".btf", ".npz", ".7z", ".rar"),
    *(".tar", ".tgz", ".tbz2", ".txz", ".gz", ".bz2", ".xz", ".zst"),
)
TABLES = (".binary", ".bsdf", ".parquet")


def left_out_notes(
    path: Path, files: Iterable[str], taken: Iterable[str | None], pattern: str | None = None
) -> tuple[str, ...]:
    """A line if files that might be part of a BTF are not read: no input is left out in silence.

    Args:
        path: zip or folder.
        files: names of all files in it.
        taken: names of the files that are read.
        pattern: of names with directions.

    Raises:
        DataError: the zip is damaged.
    """
    read = set(taken)
    rest = [*(name for name in files if name not in read), *beside_inner_zip(path)]
    lost = [name for name in rest if _might_be_data(name, pattern)]
    if not lost:
        return ()
    more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
    return (f"note: no part of the BTF in {path}: {lost[0]!r}{more}",)


def _might_be_data(name: str, pattern: str | None) -> bool:
    """Whether a file is a picture, an archive or a table, or is named by directions."""
    known = is_picture(name) or name.lower().endswith(PACKED + TABLES)
    return known or parse_angles(name, pattern) is not None
