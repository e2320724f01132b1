"""The material that is measured, and the points that are found of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...data import BTF, Selection
from ..drawing import OfView, flip_of_pictures, snr_of_pictures
from ..scope import Bench

Row = dict[str, Any]
# What sizes and errors are told by: keys of a point.
COSTS, QUALITIES = ("bytes_per_texel", "bytes"), ("snr_db", "flip")


@dataclass(frozen=True)
class Subject:
    """A material.

    Attributes:
        name: of the material.
        btf: its decoded values.
        bench: of the command.
    """

    name: str
    btf: BTF
    bench: Bench

    def drawn(
        self,
        curve: str,
        name: str,
        of_view: OfView,
        sizes: tuple[int, int],
        seconds: float,
    ) -> Row:
        """The point of a method that gives pictures.

        Args:
            curve: method, to which the points of one line belong.
            name: of the point.
            of_view: its pictures, of what a file would hold.
            sizes: bytes that belong to texels, and bytes that they share.
            seconds: from decoded values.
        """
        snr, flip = snr_of_pictures(self.btf, of_view), flip_of_pictures(self.btf, of_view)
        each = sizes[0] / self.btf.texel_count
        return self.point(curve, name, each, sum(sizes), snr, flip, seconds)

    def point(
        self,
        curve: str,
        name: str,
        each: float,
        total: int,
        snr: float,
        flip: float | None,
        seconds: float,
        *,
        ours: bool = False,
    ) -> Row:
        """One point: `each` bytes a texel, `total` bytes, SNR in dB and mean FLIP of pictures."""
        return {
            "material": self.name,
            "curve": curve,
            "name": name,
            "ours": ours,
            "bytes_per_texel": each,
            "bytes": total,
            "snr_db": snr,
            "flip": flip,
            "seconds": seconds,
        }


def middle(btf: BTF, side: int) -> Selection | None:
    """The middle of a texture, at most `side` texels wide and high; None where that is all of it.

    A part that is spread over the texture would have no relief: its texels are no neighbours.
    """
    width, height = min(btf.width, side), min(btf.height, side)
    if (width, height) == (btf.width, btf.height):
        return None
    return Selection(crop=((btf.width - width) // 2, (btf.height - height) // 2, width, height))
