"""Groups of lobes by the paper's criterion [WDR11 §5.1], and the options that name one."""

from __future__ import annotations

from typing import Any

from ..config.schema import setting
from ..errors import ConfigError
from ..lobes.sampling import SPECULAR_WIDTH, specular_mask
from ..model.spmm import SPMM
from .selection import EVERYTHING, Selection

GROUPS = ("all", "specular", "non_specular")
# Greatest width in radians that tells groups apart; squares of much greater ones leave floats.
WIDEST = 100.0


def lobe_group(model: SPMM, group: str, threshold: float = SPECULAR_WIDTH) -> Selection:
    """The lobes of a group, in all texels.

    Args:
        model: whose lobes are selected.
        group: one of GROUPS. Lobes of models without a width, such as Lambertian and Oren-Nayar,
            are never specular; others are where they are narrower than `threshold`.
        threshold: width in radians (slope of the half vector where a lobe falls to 1/e); the paper
            leaves its value open.

    Raises:
        ConfigError: unknown group, a threshold out of its range, or no lobe in the group.
    """
    if group not in GROUPS:
        raise ConfigError(f"the group of lobes is {group!r}; expected one of {', '.join(GROUPS)}.")
    if group == "all":
        return EVERYTHING
    if not 0.0 < threshold <= WIDEST:
        raise ConfigError(
            f"the specular threshold is {threshold:g}; expected a positive width in rad, "
            f"at most {WIDEST:g}."
        )
    specular = specular_mask(model.dictionary, threshold)
    chosen = specular if group == "specular" else ~specular
    if not bool(chosen.any()):
        edge = "narrower" if group == "specular" else "wider"
        raise ConfigError(
            f"the model has no {group.replace('_', '-')} lobes, as none is {edge} than "
            f"{threshold:g} rad; choose another threshold, or other lobes."
        )
    return Selection(lobes=chosen)


def group_setting(default: str = "all") -> Any:
    """The option of an edit that names a group."""
    return setting(default, "lobes that change: all, specular or non_specular", choices=GROUPS)


def threshold_setting() -> Any:
    """The option of an edit or mask that tells specular lobes from others."""
    return setting(
        SPECULAR_WIDTH, "width in radians below which lobes are specular", low=0.0, high=WIDEST
    )
