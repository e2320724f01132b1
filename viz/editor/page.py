"""The page of the editor: its layout, and the callback of each control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..html import css
from ..palette import LINE, PAGE, QUIET, TEXT
from .drawing import TOOLS
from .sliders import SLIDERS
from .stage import MAX_REPEAT, SHAPES

# Angles of light and view: key, title, low, high.
ANGLES = (
    ("light_theta", "Light, polar", 0, 85),
    ("light_phi", "Light, azimuth", -180, 180),
    ("view_theta", "View, polar", 0, 70),
    ("view_phi", "View, azimuth", -180, 180),
)
# JavaScript for the place of the pointer, as fractions of width and height.
POINT = "[$event.offsetX / $event.target.clientWidth, $event.offsetY / $event.target.clientHeight]"
STYLE = f"""
html {{ overflow-y: auto; }}
.editor {{ background: {css(PAGE)}; color: {css(TEXT)}; min-height: 100vh; padding: 18px 24px;
  font: 14px/1.4 system-ui, "Segoe UI", Roboto, sans-serif; font-variant-numeric: tabular-nums; }}
.editor h1 {{ font-size: 19px; font-weight: 500; margin: 0; }}
.editor h2 {{ font-size: 13px; font-weight: 500; color: {css(QUIET)}; margin: 0 0 6px; }}
.bar {{ display: flex; align-items: center; gap: 10px; margin-bottom: 6px; flex-wrap: wrap; }}
.bar .space {{ flex: 1; }}
.columns {{ display: grid; gap: 22px; grid-template-columns: minmax(0, 1fr) 410px;
  align-items: start; }}
.pictures {{ display: grid; gap: 18px; grid-template-columns: 1fr 1fr; margin-bottom: 18px; }}
.pictures img {{ width: 100%; max-height: 41vh; object-fit: contain; display: block; }}
.lower {{ display: grid; gap: 18px; grid-template-columns: repeat(auto-fit, minmax(340px, 1fr)); }}
.card {{ background: #fff; border: 1px solid {css(LINE)}; border-radius: 10px; padding: 12px 14px;
  margin-bottom: 14px; }}
.slice {{ width: 100%; max-width: 260px; image-rendering: pixelated; cursor: crosshair;
  touch-action: none; user-select: none; border-radius: 4px; display: block; }}
.row {{ display: grid; grid-template-columns: 168px minmax(0, 1fr) 58px; align-items: center;
  min-height: 34px; }}
.row .value {{ text-align: right; color: {css(QUIET)}; }}
.tools {{ display: flex; flex-wrap: wrap; gap: 6px; margin-bottom: 10px; }}
.editor button {{ border: 1px solid {css(LINE)}; border-radius: 7px; background: #fff;
  padding: 4px 11px; color: {css(TEXT)}; }}
.editor button:hover:enabled {{ border-color: {css(QUIET)}; }}
.editor button:disabled {{ color: #b4b8bb; }}
.editor button.on {{ background: {css(TEXT)}; color: #fff; border-color: {css(TEXT)}; }}
.editor input[type=text] {{ border: 1px solid {css(LINE)}; border-radius: 7px; padding: 4px 9px;
  background: #fff; min-width: 0; }}
.message {{ min-height: 20px; color: {css(QUIET)}; }}
.message.wrong {{ color: #a33a1c; }}
pre.script {{ white-space: pre-wrap; overflow-wrap: anywhere; margin: 0; font-size: 12px;
  color: {css(QUIET)}; max-height: 230px; overflow-y: auto; }}
@media (max-width: 900px) {{ .columns {{ grid-template-columns: 1fr; }} }}
"""


@dataclass(frozen=True)
class Callbacks:
    """The functions that the controls of the page call.

    Attributes:
        undo, redo, reset, save, add: the buttons of these names.
        release: the end of a slider's move; takes its name and its value.
        choose_tool: takes the name of the tool.
    """

    undo: Callable[[], None]
    redo: Callable[[], None]
    reset: Callable[[], None]
    save: Callable[[], None]
    add: Callable[[], None]
    release: Callable[[str, float], None]
    choose_tool: Callable[[str], None]


def build_page(server: Any, callbacks: Callbacks) -> None:
    """Fills the main template of a trame server."""
    from trame.ui.vuetify3 import VAppLayout
    from trame.widgets import client, html

    with VAppLayout(server):
        client.Style(STYLE)
        with html.Div(
            classes="editor",
            tabindex="-1",  # keys reach it even if nothing in it has the focus
            undo_key=callbacks.undo,
            redo_key=callbacks.redo,
            __properties=["tabindex"],
            __events=[("undo_key", "keydown.ctrl.z.exact"), ("redo_key", "keydown.ctrl.y.exact")],
        ):
            _bar(callbacks)
            with html.Div(classes="columns"):
                with html.Div():
                    _pictures()
                    with html.Div(classes="lower"):
                        _selection(callbacks)
                        _setting()
                with html.Div():
                    _sliders(callbacks)
                    _script()


def _bar(callbacks: Callbacks) -> None:
    """Title, history, and saving."""
    from trame.widgets import html

    with html.Div(classes="bar"):
        html.H1("{{ title }}")
        html.Div(classes="space")
        html.Button("Undo", id="undo", click=callbacks.undo, disabled=("!can_undo",))
        html.Button("Redo", id="redo", click=callbacks.redo, disabled=("!can_redo",))
        html.Button("Reset", id="reset", click=callbacks.reset, disabled=("!script",))
        html.Input(
            type="text", id="save_name", v_model=("save_name",), placeholder="folder to save as"
        )
        html.Button("Save", id="save", click=callbacks.save, disabled=("!save_name",))
    html.Div("{{ message }}", id="message", classes=("wrong ? 'message wrong' : 'message'",))


def _pictures() -> None:
    """Original and edited."""
    from trame.widgets import html

    with html.Div(classes="pictures"):
        for key, title in (("original", "Original"), ("edited", "Edited")):
            with html.Div():
                html.H2(title)
                html.Img(
                    src=(f"{key}_image",),
                    id=key,
                    alt=title,
                    aria_busy=("busy",),  # until it is smooth, and of what the sliders say
                    __properties=[("aria_busy", "aria-busy")],
                )


def _selection(callbacks: Callbacks) -> None:
    """The texture, on which a part is selected."""
    from trame.widgets import html

    with html.Div(classes="card"):
        html.H2("Selection")
        with html.Div(classes="tools"):
            for tool in TOOLS:
                html.Button(
                    tool,
                    id=f"tool_{tool}",
                    click=(callbacks.choose_tool, f"['{tool}']"),
                    classes=(f"tool === '{tool}' ? 'on' : ''",),
                )
        html.Img(
            src=("slice_image",),
            id="slice",
            alt="Texture and selection",
            classes="slice",
            draggable="false",
            __events=["pointerdown", "pointermove", "pointerup"],
            pointerdown=f"$event.target.setPointerCapture($event.pointerId); "
            f"trigger('press', {POINT})",
            pointermove=f"$event.buttons && trigger('drag', {POINT})",
            pointerup=f"trigger('drop', {POINT})",
        )
        _row("Brush", "brush", 0.01, 0.3, 0.01, "")


def _setting() -> None:
    """Shape, light and view."""
    from trame.widgets import html

    with html.Div(classes="card"):
        html.H2("Shape, light and view")
        with html.Div(classes="tools"):
            for shape in SHAPES:
                html.Button(
                    shape,
                    id=f"shape_{shape}",
                    click=f"shape = '{shape}'",
                    classes=(f"shape === '{shape}' ? 'on' : ''",),
                )
        for key, title, low, high in ANGLES:
            _row(title, key, low, high, 1, "°")
        _row("Repeat", "repeat", 1, MAX_REPEAT, 1, "×")


def _sliders(callbacks: Callbacks) -> None:
    """All sliders, and a line for edits that have none."""
    from trame.widgets import html

    with html.Div(classes="card"):
        html.H2("{{ selected }}")
        for slider in SLIDERS:
            _row(
                slider.title,
                slider.name,
                slider.low,
                slider.high,
                slider.step,
                slider.unit,
                disabled=(f"!usable.{slider.name}",),
                end=(callbacks.release, f"['{slider.name}', $event]"),
            )
        html.H2("Any other edit, as scripts write it", style="margin-top: 14px")
        with html.Div(classes="bar", style="margin: 0; flex-wrap: nowrap"):
            html.Input(
                type="text",
                id="typed",
                v_model=("typed",),
                placeholder="replace_model: {name: ward}",
                style="flex: 1",
            )
            html.Button("Add", id="add", click=callbacks.add, disabled=("!typed",))


def _script() -> None:
    """All edits so far."""
    from trame.widgets import html

    with html.Div(classes="card"):
        html.H2("Script")
        html.Pre("{{ script || 'no edits yet' }}", id="script", classes="script")


def _row(
    title: str, key: str, low: float, high: float, step: float, unit: str, **options: Any
) -> None:
    """Title, slider and value."""
    from trame.widgets import html
    from trame.widgets import vuetify3 as vuetify

    with html.Div(classes="row"):
        html.Span(title)
        vuetify.VSlider(
            v_model=(key,),
            id=f"slider_{key}",
            min=low,
            max=high,
            step=step,
            hide_details=True,
            density="compact",
            thumb_size=14,
            track_size=2,
            **options,
        )
        digits = 0 if step >= 1 else 2
        html.Span(f"{{{{ {key}.toFixed({digits}) }}}} {unit}", classes="value")
