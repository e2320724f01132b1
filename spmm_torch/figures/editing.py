"""Fig. 4, 5, 6, 7 and 9: edits of a model, rendered [WDR11 §5].

Each function takes a model and a view of it, and returns rows of labelled linear renderings of one
exposure, with their numbers. The edits are those of `configs/edits`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..edit import Script, change_colours
from ..edit.edits.hue_saturation import HueSaturation
from ..edit.examples import example
from ..geometry.grazing import grazing_fade, lowest_cosine
from ..geometry.hemisphere import HemisphereInterpolation
from ..model.spmm import SPMM
from ..render import Rendering, RenderSettings, Scene, auto_exposure, render
from ..render.material import Material

FIGURE4 = {"fig4_left": "hue -110°", "fig4_middle": "hue +116°", "fig4_right": "desaturated"}


@dataclass(frozen=True)
class Labelled:
    """A linear picture `[size, size, 3]` and its label."""

    label: str
    picture: Tensor


@dataclass(frozen=True)
class Editing:
    """A figure of edits.

    Attributes:
        rows: pictures side by side.
        exposure: of all pictures; the best one for the first.
        values: numbers of the figure.
    """

    rows: tuple[tuple[Labelled, ...], ...]
    exposure: float
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class View:
    """Scene, settings and device of the renderings of a figure."""

    scene: Scene
    settings: RenderSettings
    device: torch.device | str = "cpu"

    def of(self, material: Material) -> Rendering:
        """The rendering of a material."""
        return render(material, self.scene, self.settings, self.device)


@dataclass(frozen=True)
class AsMeasured:
    """A model in the original BTF format: values at the measured directions, linear between them.

    It equals the `BTFMaterial` of the tabulated model, without the table.

    Attributes:
        model: the values.
        light, view: meshes of its measured directions.
    """

    model: SPMM
    light: HemisphereInterpolation
    view: HemisphereInterpolation

    @classmethod
    def build(cls, model: SPMM) -> AsMeasured:
        """The material of a model."""
        meshes = (HemisphereInterpolation.build(each) for each in (model.light, model.view))
        return cls(model, *meshes)

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Linear cosine-weighted RGB `[..., C]`; see `Material`."""
        light, light_weight = self.light.weights(wi)  # [..., 3]
        view, view_weight = self.view.weights(wo)  # [..., 3]
        fade = grazing_fade(wi[..., 2:], lowest_cosine(self.model.light)) * (wo[..., 2:] > 0.0)
        value = self.model(
            uv[..., None, None, :],
            self.model.light[light][..., None, :, :],
            self.model.view[view][..., :, None, :],
        )  # [..., 3, 3, C], views by lights
        return torch.einsum("...v,...l,...vlc->...c", view_weight, light_weight * fade, value)


def figure4(model: SPMM, view: View) -> Editing:
    """Hue and saturation by M above, by post-processing below, with their mean difference.

    The difference is the mean distance of covered pixels in linear RGB, as a fraction of white.
    """
    before = view.of(model)
    exposure = exposure_of(before)
    covered = before.coverage > 0.0
    top = [Labelled("original", before.picture)]
    bottom = [Labelled("original", before.picture)]
    values = {}
    for name, label in FIGURE4.items():
        script = example(name)
        edited = view.of(script.apply(model)).picture
        exact = post_processed(before.picture, script)
        top.append(Labelled(f"{label}: edited model", edited))
        bottom.append(Labelled(f"{label}: post-processed", exact))
        distance = (edited - exact)[covered].norm(dim=1).mean()
        values[f"{name}_difference"] = exposure * float(distance)
    return Editing((tuple(top), tuple(bottom)), exposure, values)


def post_processed(picture: Tensor, script: Script) -> Tensor:
    """A picture `[..., 3]` after the exact hue and saturation of a script [WDR11 Fig. 4]."""
    for step in script.steps:
        if isinstance(step.edit, HueSaturation):
            turn = math.radians(step.edit.hue)
            picture = change_colours(picture, turn, step.edit.saturation)
    return picture


def figure5(model: SPMM, view: View) -> Editing:
    """Stronger specular lobes, then another specular hue."""
    return _sequence(
        model, view, {"fig5_intensity": "more specular", "fig5_hue": "green highlights"}
    )


def figure6(model: SPMM, view: View) -> Editing:
    """Narrower specular lobes, and the same in the original format, which is blurrier."""
    edited = example("fig6").apply(model)
    before = view.of(model)
    row = (
        Labelled("original", before.picture),
        Labelled("more metallic", view.of(edited).picture),
        Labelled("original format", view.of(AsMeasured.build(edited)).picture),
    )
    exposure = exposure_of(before)
    brightest = {part.label: exposure * float(part.picture.max()) for part in row}
    return Editing((row,), exposure, {f"brightest, {k}": v for k, v in brightest.items()})


def figure7(model: SPMM, view: View) -> Editing:
    """Normals spread out."""
    return _sequence(model, view, {"fig7": "rougher"})


def figure9(model: SPMM, view: View) -> Editing:
    """Embossed, then red stripes, then golden ones."""
    steps = {"fig9_embossed": "embossed", "fig9_red": "red stripes", "fig9": "golden stripes"}
    return _sequence(model, view, steps)


def exposure_of(rendering: Rendering) -> float:
    """The exposure that shows a rendering best."""
    return auto_exposure([rendering.picture], [rendering.coverage])


def _sequence(model: SPMM, view: View, examples: dict[str, str]) -> Editing:
    """The original and its edits by some examples."""
    before = view.of(model)
    row = [Labelled("original", before.picture)]
    for name, label in examples.items():
        row.append(Labelled(label, view.of(example(name).apply(model)).picture))
    return Editing((tuple(row),), exposure_of(before))


EDITING: dict[str, Callable[[SPMM, View], Editing]] = {
    "figure4": figure4,
    "figure5": figure5,
    "figure6": figure6,
    "figure7": figure7,
    "figure9": figure9,
}
