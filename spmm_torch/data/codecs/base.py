"""The interface of a codec: a module that decodes the bytes of one picture to codes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ...runtime.foreign import foreign_kind
from ..expansion import Expansion


class UnsuitableError(ValueError):
    """A complete picture is none that can be read; the text says what to do about it."""


def refuse_foreign(payload: bytes) -> None:
    """Refuses a file that is there in place of a picture.

    Raises:
        UnsuitableError: it is an archive, a pointer or a web page.
    """
    if kind := foreign_kind(payload):
        raise UnsuitableError(f"it is {kind.what}; expected the picture itself: {kind.remedy}")


class Codec(Protocol):
    """The names in the module of a codec.

    One whose pictures may be parts of a frame also has `corner(payload)`, the column and row in it
    of their first pixel.
    """

    @property
    def TITLE(self) -> str:  # noqa: N802
        """The name of the format in messages."""
        ...

    @property
    def SUFFIXES(self) -> Sequence[str]:  # noqa: N802
        """The suffixes of its files, in lower case."""
        ...

    @property
    def HDR(self) -> bool:  # noqa: N802
        """Whether values may exceed 1."""
        ...

    def accepts(self, head: bytes) -> bool:
        """Whether a file that starts with these bytes has this format."""
        ...

    def decode(self, payload: bytes, ignore_alpha: bool = False) -> np.ndarray:
        """Codes `[H, W, B]` of a file as it stores them, row 0 at the top.

        Args:
            payload: content of the file.
            ignore_alpha: read what is transparent as if it were not, instead of refusing it;
                without effect on formats that know no transparency.

        Raises:
            ValueError: the picture is malformed or truncated; the text says how.
        """
        ...

    def expansion(self, gamma: float) -> Expansion:
        """The expansion of codes `[..., B]` to linear values `[..., 3]`.

        Args:
            gamma: exponent that turns display-encoded codes into linear values; without effect on
                linear pictures.
        """
        ...
