"""How close M comes to the exact edit on pictures: `python -m tests.benchmarks.hue_saturation RUN`.

20 changes of hue and saturation on a sphere. The edited model is rendered, and compared with the
exact change of the picture of the unedited one, beside the best 3 x 3 matrix that least squares
finds on that very picture [WDR11 §5.1, Fig. 4].
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from kornia.color import rgb_to_lab
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.edit import change_colours, hue_saturation
from spmm_torch.edit.edits.hue_saturation import FITS
from spmm_torch.render import (
    Camera,
    CosineSampled,
    DirectionalLight,
    EnvironmentLight,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    auto_exposure,
    encode_display,
    render,
)
from spmm_torch.render.environment import STUDIO_ROWS, studio_picture

# Turns in degrees and factors on the saturation, with the three changes of Fig. 4.
TURNS = (-150.0, -110.0, -75.0, -45.0, -15.0, 15.0, 45.0, 75.0, 116.0, 180.0)
FACTORS = (0.0, 0.3, 0.6, 1.3, 1.6)
BOTH = ((-110.0, 0.5), (60.0, 1.4), (116.0, 0.7), (30.0, 0.4), (180.0, 1.3))
CHANGES = (*((turn, 1.0) for turn in TURNS), *((0.0, factor) for factor in FACTORS), *BOTH)
LIGHTS = {"two": ((0.5, 0.5, 1.0), (-1.0, 0.3, 1.0)), "side": ((1.0, 0.2, 0.4),)}
BOUND = 1.1  # what is asked for, times the difference of the best matrix


@dataclass(frozen=True)
class Row:
    """Mean colour differences of one change, CIE 1976 (Delta E*ab), and in linear RGB."""

    hue: float
    saturation: float
    lab: dict[str, float]
    linear: dict[str, float]


def lights_of(name: str) -> tuple[DirectionalLight | EnvironmentLight, ...]:
    """Two lights, one from the side, or the studio in grey: coloured light changes what a turn of
    the picture's hue means, but not what one of the material's does."""
    if name == "studio":
        grey = studio_picture(STUDIO_ROWS).mean(-1, keepdim=True).expand(-1, -1, 3)
        return (EnvironmentLight.build(grey.contiguous(), "the grey studio"),)
    return tuple(DirectionalLight.build(direction) for direction in LIGHTS[name])


def best_matrix(before: Tensor, after: Tensor) -> Tensor:
    """The 3 x 3 matrix that takes colours `[N, 3]` to others with the least squared error."""
    return torch.linalg.lstsq(before.double(), after.double()).solution.T.to(before)


def lab(linear: Tensor, exposure: float) -> Tensor:
    """L*a*b* `[N, 3]` of linear colours `[N, 3]` as displayed."""
    return rgb_to_lab(encode_display(linear * exposure).T[:, :, None])[:, :, 0].T


def difference(first: Tensor, second: Tensor) -> float:
    """The mean distance of colours `[N, 3]`."""
    return float((first - second).norm(dim=1).mean())


@torch.no_grad()
def compare(model: SPMM, settings: RenderSettings, scene: Scene) -> list[Row]:
    """A row for each change; all pictures by the same directions, so that noise is the same."""
    original = render(CosineSampled(model), scene, settings)
    covered = original.coverage > 0.0
    before = original.picture[covered].clamp(min=0.0)  # [N, 3]
    rows = []
    for degrees, saturation in CHANGES:
        hue = math.radians(degrees)
        exact = change_colours(before, hue, saturation)
        found = {"best": before @ best_matrix(before, exact).T}
        for fit in FITS:
            edited = hue_saturation(model, hue, saturation, fit=fit)
            found[fit] = render(CosineSampled(edited), scene, settings).picture[covered]
        found = {name: part.clamp(min=0.0) for name, part in found.items()}  # as displayed
        exposure = auto_exposure([exact], [torch.ones(len(exact))])
        shown = lab(exact, exposure)
        rows.append(
            Row(
                degrees,
                saturation,
                {name: difference(lab(part, exposure), shown) for name, part in found.items()},
                {name: difference(part, exact) * exposure for name, part in found.items()},
            )
        )
    return rows


def main() -> None:
    """Prints a table and what it says of the bound."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--repeat", type=float, default=1.0)
    parser.add_argument("--lights", choices=(*LIGHTS, "studio"), default="two")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    shape = Sphere(Texture(options.repeat))
    scene = Scene(shape, Camera.orthographic(), lights_of(options.lights))
    rows = compare(SPMM.load(options.run), RenderSettings(options.size), scene)
    names = list(rows[0].lab)
    columns = "".join(f"{name:>10}" for name in names)
    print(f"{'degrees, factor':16}{columns}   | {columns}")
    print(f"{'':16}{'mean Delta E*ab':>30}   | {'mean linear RGB, % of white':>30}")
    for row in rows:
        shown = "".join(f"{row.lab[name]:10.2f}" for name in names)
        linear = "".join(f"{100.0 * row.linear[name]:10.2f}" for name in names)
        print(f"{row.hue:6.0f} x {row.saturation:4.1f}   {shown}   | {linear}")
    for name in FITS:
        for kind in ("lab", "linear"):
            print(verdict(rows, name, kind))


def verdict(rows: list[Row], name: str, kind: str) -> str:
    """What the rows say of one way to find M."""
    pairs = [(getattr(row, kind)[name], getattr(row, kind)["best"]) for row in rows]
    found, best = (sum(side) / len(rows) for side in zip(*pairs, strict=True))
    held = sum(one <= BOUND * other for one, other in pairs)
    unit = 1.0 if kind == "lab" else 100.0
    return (
        f"{name}, {kind}: mean {unit * found:.3f}, best matrix {unit * best:.3f}, ratio "
        f"{found / best:.3f}; {held} of {len(rows)} changes within 10 % of the best matrix"
    )


if __name__ == "__main__":
    main()
