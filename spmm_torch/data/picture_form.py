"""The form that all pictures of a set have, and their codes; a picture of another is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import Tensor

from ..errors import DataError
from .codecs import DECODE_ERRORS, Codec, codec_of
from .codecs.base import refuse_foreign
from .pictures import Archive, unreadable


class WiderFloatsError(Exception):
    """A picture of single floats was met where the first one holds half floats."""


@dataclass(frozen=True)
class PictureForm:
    """What the pictures of a set have in common.

    Attributes:
        path: zip or folder.
        codec: codec of every picture.
        size: (height, width) of every picture.
        dtype, width: type and number of the code elements of a pixel.
        corner: column and row of the first pixel of every picture, in its frame.
    """

    path: Path
    codec: Codec
    size: tuple[int, int]
    dtype: np.dtype
    width: int
    corner: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, path: Path, name: str, payload: bytes) -> PictureForm:
        """The form of a picture, the first of a set.

        Args:
            path: zip or folder.
            name: of the picture in it.
            payload: its bytes.

        Raises:
            DataError: the picture is damaged.
        """
        codec = codec_of(payload)
        try:
            first, corner = codec.decode(payload), _corner(codec, payload)
        except DECODE_ERRORS as error:
            raise unreadable(path, name, error) from error
        size = (first.shape[0], first.shape[1])
        return cls(path, codec, size, first.dtype, first.shape[2], corner)

    def decode(
        self, archive: Archive, names: Sequence[str | None], texels: Tensor | None
    ) -> np.ndarray:
        """Codes `[L', T', B]` of some pictures; missing ones are black.

        Args:
            archive: the zip or folder, opened.
            names: of the pictures; None for missing ones.
            texels: that are kept, `[T']`; None: all.

        Raises:
            DataError: a picture is damaged, or unlike the first one.
        """
        height, width = self.size
        index = None if texels is None else texels.numpy()
        count = height * width if index is None else len(index)
        codes = np.zeros((len(names), count, self.width), dtype=self.dtype)
        present = {place: name for place, name in enumerate(names) if name is not None}
        payloads = archive.read(list(present.values()))
        for (place, name), payload in zip(present.items(), payloads, strict=True):
            try:
                picture = self._decode_one(payload, name)
            except DECODE_ERRORS as error:
                raise unreadable(self.path, name, error) from error
            flat = picture.reshape(height * width, self.width)
            codes[place] = flat if index is None else flat[index]
        return codes

    def _decode_one(self, payload: bytes, name: str) -> np.ndarray:
        """Codes `[H, W, B]` of a picture that must be like the first one."""
        codes = _codes(self.codec, payload)
        if codes.shape[:2] != self.size:
            raise DataError(
                f"picture {name!r} in {self.path} is {codes.shape[1]} x {codes.shape[0]}; "
                f"expected {self.size[1]} x {self.size[0]} like the first one; all pictures must "
                f"be registered texel by texel: replace or rescale this one."
            )
        if (place := _corner(self.codec, payload)) != self.corner:
            raise DataError(
                f"picture {name!r} in {self.path} is the part of its frame from {place} on; "
                f"expected that from {self.corner} on like the first one; write whole frames, or "
                f"the same data window of all."
            )
        if (codes.dtype, codes.shape[2]) != (self.dtype, self.width):
            if np.issubdtype(self.dtype, np.floating) and codes.dtype == np.float16:
                return codes.astype(self.dtype)
            if self.dtype == np.float16 and codes.dtype == np.float32:
                raise WiderFloatsError
            raise DataError(
                f"picture {name!r} in {self.path} has values of {codes.dtype}; expected "
                f"{self.dtype} like the first one; store all pictures alike."
            )
        return codes


def _codes(codec: Codec, payload: bytes) -> np.ndarray:
    """Codes `[H, W, B]` of a picture; a ValueError if it is of another codec."""
    if not codec.accepts(payload):
        refuse_foreign(payload)
        raise ValueError(f"it is not stored like the first one, as {codec.TITLE}")
    return codec.decode(payload)


def _corner(codec: Codec, payload: bytes) -> tuple[int, int]:
    """Column and row of the first pixel of a picture in its frame."""
    tell = getattr(codec, "corner", None)
    return (0, 0) if tell is None else tell(payload)
