"""Groups of lobes by the paper's criterion, and how an edit is kept to one of them."""

from __future__ import annotations

from torch import Tensor

from ..errors import ConfigError
from ..lobes.sampling import SPECULAR_WIDTH, specular_mask
from ..model.spmm import SPMM
from .selection import Selection

GROUPS = ("all", "specular", "non_specular")


def lobe_group(model: SPMM, group: str, width: float = SPECULAR_WIDTH) -> Tensor | None:
    """Which lobes belong to a group, `[J]` bool; None for all of them.

    Args:
        group: one of GROUPS. Lambertian and Oren-Nayar lobes are never specular, the others are
            where their sharpness parameter makes them narrower than `width` [WDR11 §5.1].
        width: the threshold that the paper leaves open, radians (root mean square slope of the
            half vector).

    Raises:
        ConfigError: unknown group, a width that is not positive, or no lobe of the model belongs
            to it.
    """
    if group not in GROUPS:
        raise ConfigError(f"the group of lobes is {group!r}; expected one of {', '.join(GROUPS)}.")
    if group == "all":
        return None
    if not width > 0.0:
        raise ConfigError(f"the specular threshold is {width:g}; expected a positive width in rad.")
    specular = specular_mask(model.dictionary, width)
    chosen = specular if group == "specular" else ~specular
    if not bool(chosen.any()):
        edge = "narrower" if group == "specular" else "wider"
        raise ConfigError(
            f"the model has no {group.replace('_', '-')} lobes, as none is {edge} than "
            f"{width:g} rad; choose another threshold, or other lobes."
        )
    return chosen


def entry_share(model: SPMM, lobes: Tensor | None, where: Selection | None) -> Tensor | None:
    """The share `[N]` of each entry that is edited; None if all are, fully.

    Args:
        lobes: `[J]` bool, None for all.
    """
    if lobes is None:
        return None if where is None else where.entries
    chosen = lobes[model.index].to(model.weight)
    return chosen if where is None else chosen * where.entries


def edited_texels(lobes: Tensor | None, where: Selection | None) -> tuple[bool, Tensor | None]:
    """Whether an edit of colours reaches the residual, and its share `[T]`; None for all.

    It does where all lobes are edited; an edit of some lobes leaves the residual alone.
    """
    if lobes is not None:
        return False, None
    return where is None or where.texels is not None, None if where is None else where.texels
