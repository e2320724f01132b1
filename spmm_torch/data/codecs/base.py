"""What every codec is: a module that turns the bytes of one picture into codes and values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..codes import Expansion


class Codec(Protocol):
    """The names that the module of a codec holds."""

    @property
    def TITLE(self) -> str:  # noqa: N802
        """What error messages call such pictures."""
        ...

    @property
    def SUFFIXES(self) -> Sequence[str]:  # noqa: N802
        """How names of such files end, in lower case."""
        ...

    @property
    def HDR(self) -> bool:  # noqa: N802
        """Whether values may exceed 1."""
        ...

    def accepts(self, head: bytes) -> bool:
        """Whether a file that starts with these bytes is such a picture."""
        ...

    def decode(self, payload: bytes) -> np.ndarray:
        """Codes `[H, W, B]` of a whole file as it stores them, row 0 at the top.

        Raises:
            ValueError: the picture is malformed or truncated; the text says how.
        """
        ...

    def expansion(self, gamma: float) -> Expansion:
        """How codes `[..., B]` become linear values `[..., 3]`.

        Args:
            gamma: exponent that makes display-encoded codes linear; linear pictures ignore it.
        """
        ...
