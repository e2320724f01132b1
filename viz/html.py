"""One offline HTML file of a scene: vtk.js and the data inside, and the legend above."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np
from markupsafe import escape

from ..report.html import render_template
from ..runtime.atomic import new_file
from .palette import PAGE, QUIET, TEXT, Colour
from .plotter import ROOM, draw
from .scene import Scene

# The page would load its icon from the network; an empty icon takes its place.
ICON = "https://kitware.github.io/vtk-js/icon/favicon-${t}x${t}.png"
# Width over height of the narrowest window in which a flat scene is seen whole.
WINDOW_ASPECT = 1.2
TITLE = "<title>VTK.js | Example - OfflineLocalView</title>"


def save_html(scene: Scene, path: Path | str) -> None:
    """Writes a scene that turns in any browser, without a network.

    Raises:
        OutputError: the file cannot be written.
    """
    from trame_vtk.tools.vtksz2html import write_html

    plotter = draw(scene, off_screen=True)
    width, height = scene.size
    if plotter.camera.parallel_projection:  # a window is narrower than maps side by side
        factor = max(width / height / WINDOW_ASPECT, 1.0)
        plotter.camera.parallel_scale *= factor
        camera = plotter.camera  # web pages draw in perspective, by the distance
        camera.position = scene.view.focus + max(factor / ROOM, 1.0) * (
            np.asarray(camera.position) - scene.view.focus
        )
        plotter.renderer.ResetCameraClippingRange()
    plotter.render()
    page = io.StringIO()
    write_html(_packed(plotter.render_window), page)
    plotter.close()
    with new_file(path) as temporary:
        temporary.write_text(with_legend(page.getvalue(), scene), encoding="utf-8")


def _packed(window: Any) -> bytes:
    """The scene of a `vtkRenderWindow` as the offline viewer of vtk.js reads it.

    As trame-vtk packs it for `pyvista.export_html`, but without starting a server.
    """
    from trame_vtk.modules.vtk import serializers

    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    reference = serializers.reference_id(window)
    # None for objects without a serializer; render windows have one.
    state = cast("dict[str, Any]", serializers.serialize(None, window, reference, context, 1))
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    state["extra"] = {
        "vtkRefId": reference,
        "centerOfRotation": camera.GetFocalPoint(),
        "camera": serializers.reference_id(camera),
    }
    arrays = {
        array["hash"]: {**array, "content": context.get_cached_data_array(array["hash"], False)}
        for array in serializers.extract_array_hash(state)
    }
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        text = json.dumps({"hashes": arrays, "scene": state})
        file.writestr("index.json", text, compress_type=zipfile.ZIP_DEFLATED)
    return content.getvalue()


def with_legend(page: str, scene: Scene) -> str:
    """The page with the scene's own title and legend, and without a call to the network."""
    rows = [(None if row.colour is None else css(row.colour), row.text) for row in scene.legend]
    legend = render_template(
        "legend.html.j2",
        {
            "title": scene.title,
            "rows": rows,
            "background": css(PAGE),
            "text": css(TEXT),
            "quiet": css(QUIET),
        },
    )
    page = page.replace(TITLE, f"<title>{escape(scene.title)}</title>").replace(ICON, "data:,")
    return page.replace("<body>", legend, 1)


def css(colour: Colour) -> str:
    """A colour as CSS writes it: `#3062ab`."""
    return "#" + bytes(round(255 * x) for x in colour).hex()
