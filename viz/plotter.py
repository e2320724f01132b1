"""Draws a scene with pyvista: as a picture, or in a window."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.atomic import new_file
from .palette import PAGE, QUIET, TEXT, Colour
from .scene import Arrow, Dots, Floats, Lines, Picture, Scene, Surface, View, Word

# The legend, in points and pixels: letters of title and rows, height of a row, gap, margin.
TITLE_SIZE, ROW_SIZE, ROW_HEIGHT, GAP, MARGIN = 13, 9, 21, 8, 24
# The perspective camera: field of view in degrees, and the factor on its distance for a margin.
VIEW_ANGLE, ROOM = 30.0, 1.3
# Arrows: radii of shaft and head, and length of the head, as fractions of the whole length.
SHAFT, HEAD, HEAD_LENGTH = 0.008, 0.022, 0.08
MATTE = {"ambient": 0.35, "diffuse": 0.7, "specular": 0.08, "specular_power": 12}


def draw(scene: Scene, off_screen: bool) -> Any:
    """A `pyvista.Plotter` that shows a scene; the caller closes it."""
    plotter = _new_plotter(off_screen, scene.size)
    plotter.set_background(PAGE)
    plotter.enable_anti_aliasing("ssaa" if off_screen else "msaa")
    plotter.enable_depth_peeling(8)
    for part in scene.parts:
        DRAWN[type(part)](plotter, part)
    _set_view(plotter, scene.view)
    return plotter


def _new_plotter(off_screen: bool, size: tuple[int, int]) -> Any:
    """An empty plotter; `Any`, because the types of pyvista's decorated methods are wrong."""
    import pyvista

    return pyvista.Plotter(off_screen=off_screen, window_size=list(size))


def save_picture(scene: Scene, path: Path | str) -> None:
    """Writes a scene with its legend as a PNG.

    Raises:
        OutputError: the file cannot be written.
    """
    from PIL import Image

    codes = picture(scene)
    with new_file(path) as temporary:
        Image.fromarray(codes).save(temporary, "PNG", optimize=True)


def picture(scene: Scene) -> NDArray[np.uint8]:
    """Codes `[H, W, 3]` of a scene with its legend, drawn without a screen."""
    plotter = draw(scene, off_screen=True)
    _write_legend(plotter, scene)
    codes = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(codes)[..., :3]


def show(scene: Scene) -> None:
    """Opens a window and returns once it is closed."""
    plotter = draw(scene, off_screen=False)
    _write_legend(plotter, scene)
    plotter.show(title=scene.title)


def _set_view(plotter: Any, view: View) -> None:
    """Points the camera: parallel rays, at the distance that perspective needs on web pages."""
    distance = ROOM * view.half_height / math.tan(math.radians(0.5 * VIEW_ANGLE))
    plotter.camera.focal_point = view.focus
    plotter.camera.position = view.focus + distance * view.direction
    plotter.camera.up = view.up
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = view.half_height
    plotter.renderer.ResetCameraClippingRange()


def _write_legend(plotter: Any, scene: Scene) -> None:
    """Title and rows at the upper left, each row after a square of its colour."""
    top = scene.size[1] - MARGIN - 2 * TITLE_SIZE
    _text(plotter, scene.title, (MARGIN, top), TITLE_SIZE, TEXT)
    for number, row in enumerate(scene.legend):
        y = top - 12 - (number + 1) * ROW_HEIGHT - GAP * (row.colour is not None)
        if row.colour is not None:
            _text(plotter, "■", (MARGIN, y), ROW_SIZE, row.colour)
        indent = MARGIN if row.colour is None else MARGIN + 22
        _text(plotter, row.text, (indent, y), ROW_SIZE, QUIET if row.colour is None else TEXT)


def _text(plotter: Any, text: str, at: tuple[float, float], size: int, colour: Colour) -> None:
    plotter.add_text(text, position=at, font_size=size, color=colour, font_file=font_file())


def font_file() -> str | None:
    """matplotlib's DejaVu font, which has every letter of a legend; None for VTK's own font."""
    from importlib.util import find_spec

    spec = find_spec("matplotlib")
    if spec is None or spec.origin is None:
        return None
    file = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return str(file) if file.is_file() else None


def _mesh(points: Floats, triangles: NDArray[np.int64]) -> Any:
    import pyvista

    faces = np.column_stack((np.full(len(triangles), 3), triangles)).ravel()
    return pyvista.PolyData(points.astype(np.float32), faces)


def _surface(plotter: Any, part: Surface) -> None:
    plotter.add_mesh(
        _mesh(part.points, part.triangles),
        color=part.colour,
        opacity=part.opacity,
        lighting=not part.flat,
        smooth_shading=not part.flat,
        culling="back" if part.opacity < 1.0 else "none",  # back faces would look like stains
        **MATTE,
    )


def _lines(plotter: Any, part: Lines) -> None:
    import pyvista

    count, length = part.points.shape[:2]
    index = np.arange(count * length).reshape(count, length)
    cells = np.column_stack((np.full(count, length), index)).ravel()
    mesh = pyvista.PolyData(part.points.reshape(-1, 3), lines=cells)
    plotter.add_mesh(mesh, color=part.colour, line_width=part.width, lighting=False)


def _arrow(plotter: Any, part: Arrow) -> None:
    import pyvista

    mesh = pyvista.Arrow(
        start=part.start,
        direction=part.vector,
        scale=float(np.linalg.norm(part.vector)),
        shaft_radius=SHAFT,
        tip_radius=HEAD,
        tip_length=HEAD_LENGTH,
    )
    plotter.add_mesh(mesh, color=part.colour, **MATTE)


def _dots(plotter: Any, part: Dots) -> None:
    import pyvista

    cloud = pyvista.PolyData(part.points)
    cloud["colour"] = _codes(part.colours)
    ball = pyvista.Sphere(radius=part.radius, theta_resolution=12, phi_resolution=12)
    mesh = cloud.glyph(geom=ball, scale=False, orient=False)
    plotter.add_mesh(mesh, scalars="colour", rgb=True, smooth_shading=True, **MATTE)


def _word(plotter: Any, part: Word) -> None:
    mesh = _letters(part.text)
    capital = float(_letters("H").points[:, 1].max())  # letters stand on y = 0
    left, right = mesh.bounds[:2]
    origin = (left if part.align == "left" else 0.5 * (left + right), 0.5 * capital, 0.0)
    flat = (mesh.points - origin) * (part.height / capital)
    mesh.points = part.at + flat[:, :1] * part.right + flat[:, 1:2] * part.up
    plotter.add_mesh(mesh, color=part.colour, lighting=False)


def _letters(text: str) -> Any:
    """A line of letters as triangles."""
    import pyvista
    from vtkmodules.vtkRenderingFreeType import vtkVectorText

    source = vtkVectorText()
    source.SetText(text)
    source.Update()
    return pyvista.wrap(source.GetOutput())


def _picture(plotter: Any, part: Picture) -> None:
    import pyvista

    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
    points = part.centre + corners[:, :1] * part.right + corners[:, 1:] * part.up
    mesh = pyvista.PolyData(points, np.array([4, 0, 1, 2, 3]))
    mesh.active_texture_coordinates = 0.5 * (corners + 1.0)
    texture = pyvista.numpy_to_texture(np.ascontiguousarray(part.codes))
    plotter.add_mesh(mesh, texture=texture, lighting=False)


def _codes(colours: Floats) -> NDArray[np.uint8]:
    return np.round(np.clip(colours, 0.0, 1.0) * 255.0).astype(np.uint8)


DRAWN: dict[type, Callable[[Any, Any], None]] = {
    Surface: _surface,
    Lines: _lines,
    Arrow: _arrow,
    Dots: _dots,
    Word: _word,
    Picture: _picture,
}
