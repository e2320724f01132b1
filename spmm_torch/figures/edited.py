"""The figures of edits as drawings: labelled rows of pictures with a caption."""

from __future__ import annotations

from ..render import Camera, DirectionalLight, Scene, Sphere, Texture, display_codes
from ..runtime.device import full_precision
from .comparison import REPEAT, SUN
from .editing import EDITING, View
from .figure import Drawing, Figure, Subject
from .sheet import Panel, sheet

# Title and caption of each figure.
TITLES = {
    "figure4": (
        "Figure 4: hue and saturation",
        "Changing hue and saturation. Top: the linear approximation M of Eq. 6 and 7, applied to "
        "the weights of the model. Bottom: the same change of the rendered pixels.",
    ),
    "figure5": (
        "Figure 5: specular intensity and hue",
        "The original, with more specular lobes, and with another hue of them.",
    ),
    "figure6": (
        "Figure 6: more metallic",
        "Narrower specular lobes, and the same known at the measured directions only, where the "
        "highlights are blurrier.",
    ),
    "figure7": ("Figure 7: rougher", "The original, and with its normals spread out."),
    "figure9": (
        "Figure 9: a series of edits",
        "The original, embossed, with red stripes, and with golden ones.",
    ),
}


def edited_figures() -> tuple[Figure, ...]:
    """A figure for each of `EDITING`."""
    return tuple(_figure(name) for name in EDITING)


def _figure(name: str) -> Figure:
    title, caption = TITLES[name]

    def draw(subject: Subject) -> Drawing:
        choices = subject.choices
        lights = (DirectionalLight.build(SUN),)
        shape = Sphere(Texture(REPEAT, subject.aspect))
        view = View(Scene(shape, Camera.orthographic(), lights), choices.settings(), subject.device)
        with subject.progress.stage(name), full_precision():
            found = EDITING[name](subject.model, view)
        rows = [
            [Panel(display_codes(part.picture, found.exposure), part.label) for part in row]
            for row in found.rows
        ]
        return Drawing(sheet(rows), caption, {"exposure": found.exposure, **found.values})

    return Figure(name, title, draw)
