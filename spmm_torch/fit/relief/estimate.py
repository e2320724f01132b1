"""The relief that a BTF needs: a plane, heights, a drift of its views, or nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from ...data import BTF
from ...errors import ConfigError
from ...geometry.directions import REPEAT
from .border import continuation
from .given import best_scale, read_heights, stored_heights
from .pictures import chosen_views
from .plane import find_plane
from .search import Search
from .sweep import sweep_heights

OFF, PLANE, AUTO = "off", "plane", "auto"
MODES, DRIFTS = (OFF, PLANE, AUTO), (AUTO, OFF)
# Views and texels of a side of which there must be as many: fewer tell no heights.
LEAST_VIEWS, LEAST_SIDE = 3, 8
# Registrations over a plane, which itself follows from them.
REGISTRATIONS = 2
# Levels of a height: it is stored in one byte.
LEVELS = 255


@dataclass(frozen=True)
class Estimate:
    """The relief of a BTF.

    Attributes:
        height: heights `[H, W]`, or one of the whole plane, in texture widths above the plane in
            which pictures were rectified; None: the surface is flat, in that plane.
        drift: shift of each view, `[V, 2]` in units of u and v: it shows at p + shift what belongs
            at p; None: none.
        rule: how the texture continues beyond its border, "repeat" or "mirror".
        left: fraction of the disagreement of views that is left, under lights that were not used,
            by what was tried: "plane", "relief", "drift".
        lines: what was found, for the log.
    """

    height: Tensor | float | None = None
    drift: Tensor | None = None
    rule: str = REPEAT
    left: dict[str, float] = field(default_factory=dict)
    lines: tuple[str, ...] = ()


def estimate_relief(
    btf: BTF,
    *,
    mode: str = AUTO,
    height: Path | str | None = None,
    height_scale: float | None = None,
    drift: str = AUTO,
    device: torch.device | str = "cpu",
) -> Estimate:
    """As much of a relief as the views of a BTF agree better by.

    Only the pictures that are looked at are decoded: steep views under a few lights. What is found
    must pay under lights that it was not found under; else it is exactly None.

    Args:
        btf: the BTF.
        mode: "off"; "plane": one height for all texels at most; "auto": as much as pays.
        height: picture of the heights, which are then kept and not sought; None: none is given.
        height_scale: height of white above black in that picture, in texture widths; None: found.
        drift: "auto": registration of each view is found; "off": taken as exact.
        device: device to compute on.

    Raises:
        ConfigError: a mode that is not known.
        DataError: the height map cannot be used, or a picture cannot be decoded.
        OutputError: the decoded values cannot be kept on disk.
    """
    _check(mode, MODES, "relief.mode")
    _check(drift, DRIFTS, "relief.drift")
    given = None if height is None else read_heights(height, btf.height, btf.width)
    if mode == OFF:
        return Estimate()
    reason = _hopeless(btf)
    if reason is not None:
        return Estimate(lines=(f"no relief is sought: {reason}",))
    search = Search.open(btf, device)
    if not bool(search.sought.weight.any()):
        return Estimate(lines=("no relief is sought: the pictures have no texture",))
    if given is not None and mode == AUTO:
        return _of_given(search, given, height_scale, drift == AUTO)
    return _found(search, mode, drift == AUTO)


def _check(value: str, choices: tuple[str, ...], name: str) -> None:
    if value not in choices:
        raise ConfigError(f"{name} is {value!r}; expected one of {', '.join(choices)}.")


def _hopeless(btf: BTF) -> str | None:
    """Why no relief can be found in a BTF; None if it may be."""
    if len(btf.view) == 1:
        return "it shows between views, and there is only one"
    views = len(chosen_views(btf))
    if views < LEAST_VIEWS:
        return f"it shows between views, of which {views} are steep enough; 3 are needed"
    if min(btf.height, btf.width) < LEAST_SIDE:
        return f"{btf.width} x {btf.height} texels are too few; 8 x 8 are needed"
    return None


def _of_given(search: Search, shape: Tensor, scale: float | None, register: bool) -> Estimate:
    """The relief of a map that is given, `[H, W]` in [0, 1], over the plane that fits it."""
    shape = shape.to(search.sought.values.device)
    scale = best_scale(search.sought, shape)[0] if scale is None else scale
    relief = scale * shape
    relief = relief + find_plane(search.sought, relief)
    if register:
        search, more = search.registered(relief)
        relief = relief + more
    relief = one_byte(relief)
    return _estimate(search, relief.cpu(), relief, {"relief": search.left(relief)})


def _found(search: Search, mode: str, register: bool) -> Estimate:
    """What pays of plane, drift and heights."""
    plane = find_plane(search.sought)
    for _ in range(REGISTRATIONS if register else 0):
        search, more = search.registered(search.flat(plane))
        plane += more
        if more == 0.0:
            break
    flat = search.flat(plane)
    left = {"plane": search.left(flat)}
    base, height = (flat, plane) if search.plane_pays(plane) else (search.flat(0.0), None)
    if mode == AUTO:
        swept = _swept(search, plane)
        moved, more = search.registered(swept) if register else (search, 0.0)
        swept = one_byte(swept + more)
        left["relief"] = moved.left(swept)
        if moved.heights_pay(swept, base):
            return _estimate(moved, swept.cpu(), swept, left)
    return _estimate(search, height, base, left)


def _swept(search: Search, plane: float) -> Tensor:
    """Heights `[H, W]` of the sweep, or of one that starts from the map of the file, if better."""
    swept = sweep_heights(search.sought, plane)
    shape = stored_heights(search.btf)
    if shape is None:
        return swept
    shape = shape.to(swept.device)
    scale, offset = best_scale(search.sought, shape)
    started = sweep_heights(search.sought, plane, scale * shape + offset)
    return min((swept, started), key=search.left)


def one_byte(height: Tensor) -> Tensor:
    """The heights `[H, W]`, rounded to the 256 levels that one byte holds."""
    low, high = height.aminmax()
    step = (high - low) / LEVELS
    if float(step) == 0.0:
        return height
    return low + step * ((height - low) / step).round()


def _estimate(
    search: Search, height: Tensor | float | None, relief: Tensor, left: dict[str, float]
) -> Estimate:
    """The estimate of a search that ended with a `relief [H, W]`."""
    rule = continuation(search.sought, relief)
    drift = search.drift_of_all_views(relief)
    said = f"relief: {_described(height)}; drift of views: {_drift_described(drift, search)}"
    told = "".join(f"; {share:.0%} of the parallax left by {name}" for name, share in left.items())
    return Estimate(height, drift, rule, left, (f"{said}; border: {rule}{told}",))


def _described(height: Tensor | float | None) -> str:
    if height is None:
        return "none, the surface is flat"
    if not isinstance(height, Tensor):
        return f"a plane at {height:.2%} of the width"
    return f"heights from {float(height.min()):.2%} to {float(height.max()):.2%} of the width"


def _drift_described(drift: Tensor | None, search: Search) -> str:
    if drift is None:
        return "none"
    rows, columns = search.sought.size
    texels = (drift * torch.tensor([columns, rows])).norm(dim=1)
    return f"up to {float(texels.max()):.2f} texels"
