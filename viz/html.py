"""One offline HTML file of a scene: vtk.js and the data inside, and the legend above."""

from __future__ import annotations

import io
import json
import zipfile
from html import escape
from pathlib import Path
from typing import Any

from ..runtime.atomic import new_file
from .palette import PAGE, QUIET, TEXT, Colour
from .plotter import draw
from .scene import LegendRow, Scene

# The page asks the network for its own icon only; an empty one is taken instead.
ICON = "https://kitware.github.io/vtk-js/icon/favicon-${t}x${t}.png"
TITLE = "<title>VTK.js | Example - OfflineLocalView</title>"
# vtk.js clears this element and draws in it.
FRAME = '<div class="content" style="position:absolute;inset:0"></div>'
STYLE = (
    "#legend{position:absolute;z-index:9;left:24px;top:20px;pointer-events:none;"
    "font:14px/1.5 system-ui,'Segoe UI',Roboto,sans-serif;white-space:pre}"
    "#legend h1{margin:0 0 6px;font-size:19px;font-weight:500}"
    "#legend i{display:inline-block;width:11px;height:11px;margin-right:9px}"
)


def save_html(scene: Scene, path: Path | str) -> None:
    """Writes a scene that turns in any browser, without a network.

    Raises:
        OutputError: the file cannot be written.
    """
    from trame_vtk.tools.vtksz2html import write_html

    plotter = draw(scene, off_screen=True)
    plotter.render()
    page = io.StringIO()
    write_html(_packed(plotter.render_window), page)
    plotter.close()
    with new_file(path) as temporary:
        temporary.write_text(with_legend(page.getvalue(), scene), encoding="utf-8")


def _packed(window: Any) -> bytes:
    """The scene of a `vtkRenderWindow` as the offline viewer of vtk.js reads it.

    Done as trame-vtk does it for `pyvista.export_html`, but without the server that this starts.
    """
    from trame_vtk.modules.vtk import serializers

    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    state = serializers.serialize(None, window, serializers.reference_id(window), context, 1)
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    state["extra"] = {
        "vtkRefId": serializers.reference_id(window),
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
    title = f"<title>{escape(scene.title)}</title><style>{STYLE}</style>"
    rows = "".join(f"<div>{_row(row)}</div>" for row in scene.legend)
    legend = (
        f'<div id="legend" style="color:{css(TEXT)}"><h1>{escape(scene.title)}</h1>{rows}</div>'
    )
    page = page.replace(TITLE, title).replace(ICON, "data:,")
    return page.replace("<body>", f'<body style="background:{css(PAGE)}">{FRAME}{legend}', 1)


def css(colour: Colour) -> str:
    """`#3062ab` of a colour."""
    return "#" + bytes(round(255 * x) for x in colour).hex()


def _row(row: LegendRow) -> str:
    if row.colour is None:
        return f'<span style="color:{css(QUIET)}">{escape(row.text)}</span>'
    return f'<i style="background:{css(row.colour)}"></i>{escape(row.text)}'
