"""Reader of a binary file from front to back, which trusts none of its counts."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...errors import DataError


class Cursor:
    """Reads little-endian numbers, after a check that the file has enough bytes left.

    Every method that reads raises a DataError if the file ends early.

    Args:
        path: path of the file, for messages.
        stream: file, positioned at its start.
        size: size of the file in bytes.
    """

    def __init__(self, path: Path, stream: BinaryIO, size: int) -> None:
        self.position = 0
        self._path = path
        self._stream = stream
        self._size = size

    def take(self, count: int, what: str) -> bytes:
        """The next `count` bytes; `what` names them in messages.

        Raises:
            DataError: fewer bytes are left; no memory is allocated then.
        """
        self._require(count, what)
        payload = self._stream.read(count)
        if len(payload) != count:  # the file has shrunk meanwhile
            self._end_early(count, len(payload), what)
        self.position += count
        return payload

    def skip(self, count: int, what: str) -> None:
        """Skips `count` bytes.

        Raises:
            DataError: fewer bytes are left.
        """
        self._require(count, what)
        self.position += count
        self._stream.seek(self.position)

    def rewind(self, position: int) -> None:
        """Goes back to an earlier position, in bytes."""
        self.position = position
        self._stream.seek(position)

    def peek(self, count: int) -> bytes:
        """At most `count` of the next bytes, without moving on."""
        following = self._stream.read(count)
        self._stream.seek(self.position)
        return following

    def array(self, dtype: str | np.dtype, count: int, what: str) -> np.ndarray:
        """The next numbers of a type, `[count]`.

        Raises:
            DataError: the file ends early.
        """
        payload = self.take(count * np.dtype(dtype).itemsize, what)
        return np.frombuffer(payload, dtype=dtype)

    def integer(self, dtype: str, what: str) -> int:
        """The next integer of a type such as "<u4".

        Raises:
            DataError: the file ends early.
        """
        return int(self.array(dtype, 1, what)[0])

    def count(self, what: str, most: int | None = None) -> int:
        """The next number of things, checked to be from 1 to `most`.

        Raises:
            DataError: the number is out of this range, or the file ends early.
        """
        offset = self.position
        number = self.integer("<u4", f"the number of {what}")
        if number < 1 or (most is not None and number > most):
            expected = "1 or more" if most is None else f"1 to {most}"
            raise self.error(f"has {number} {what}", offset, expected)
        return number

    def text(self, count: int, what: str) -> str:
        """The next text, of `count` bytes, up to its first zero byte.

        Raises:
            DataError: the file ends early.
        """
        return self.take(count, what).split(b"\0", 1)[0].decode("utf-8", "replace")

    def finish(self) -> None:
        """Checks that the file ends here.

        Raises:
            DataError: more bytes follow.
        """
        if self.position != self._size:
            raise self.error(
                f"goes on for {self._size - self.position} bytes after its last factor",
                self.position,
                "the end of the file",
            )

    def error(self, what: str, offset: int, expected: str) -> DataError:
        """The error for a fault at an offset of the file, in bytes."""
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
