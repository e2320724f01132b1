"""Reading a binary file front to back without believing any count it holds."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...errors import DataError


class Cursor:
    """Reads little-endian numbers, each only if the file still has the bytes for it.

    Args:
        path: what the file is called in messages.
        stream: positioned at the start.
        size: of the whole file, bytes.
    """

    def __init__(self, path: Path, stream: BinaryIO, size: int) -> None:
        self.position = 0
        self._path = path
        self._stream = stream
        self._size = size

    def take(self, count: int, what: str) -> bytes:
        """The next `count` bytes, which hold `what`.

        Raises:
            DataError: fewer are left; nothing is allocated then.
        """
        self._require(count, what)
        payload = self._stream.read(count)
        if len(payload) != count:  # the file shrank meanwhile
            self._end_early(count, len(payload), what)
        self.position += count
        return payload

    def skip(self, count: int, what: str) -> None:
        """Step over `count` bytes that must be there."""
        self._require(count, what)
        self.position += count
        self._stream.seek(self.position)

    def rewind(self, position: int) -> None:
        """Go back to a position that was read already."""
        self.position = position
        self._stream.seek(position)

    def peek(self, count: int) -> bytes:
        """The next bytes, at most `count` of them, which stay unread."""
        following = self._stream.read(count)
        self._stream.seek(self.position)
        return following

    def array(self, dtype: str | np.dtype, count: int, what: str) -> np.ndarray:
        """`count` numbers of a type."""
        payload = self.take(count * np.dtype(dtype).itemsize, what)
        return np.frombuffer(payload, dtype=dtype)

    def integer(self, dtype: str, what: str) -> int:
        """One integer of a type such as "<u4"."""
        return int(self.array(dtype, 1, what)[0])

    def count(self, what: str, most: int | None = None) -> int:
        """A number of things, of which there must be some, and `most` at most."""
        offset = self.position
        number = self.integer("<u4", f"the number of {what}")
        if number < 1 or (most is not None and number > most):
            expected = "1 or more" if most is None else f"1 to {most}"
            raise self.error(f"has {number} {what}", offset, expected)
        return number

    def text(self, count: int, what: str) -> str:
        """A text of `count` bytes, up to its first zero byte."""
        return self.take(count, what).split(b"\0", 1)[0].decode("utf-8", "replace")

    def finish(self) -> None:
        """Check that nothing follows.

        Raises:
            DataError: something does.
        """
        if self.position != self._size:
            raise self.error(
                f"goes on for {self._size - self.position} bytes after its last factor",
                self.position,
                "the end of the file",
            )

    def error(self, what: str, offset: int, expected: str) -> DataError:
        """The error for something wrong at a byte of the file."""
        return DataError(
            f"{self._path} {what} at byte {offset}; expected {expected}; "
            f"the file is damaged or of another kind: copy it again from where it came."
        )

    def _require(self, count: int, what: str) -> None:
        left = self._size - self.position
        if count > left:
            self._end_early(count, left, what)

    def _end_early(self, count: int, left: int, what: str) -> None:
        raise self.error(
            f"ends early: {left} of {count} bytes are left for {what}",
            self.position,
            f"{count} bytes",
        )
