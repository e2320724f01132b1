"""The editor in a browser: the state of a trame page, kept in step with a session.

Callbacks only note what changed. One worker renders the newest state, so that moves of a slider
never queue up.
"""

from __future__ import annotations

import asyncio
import webbrowser
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from pathlib import Path
from threading import Thread
from typing import Any

from ...errors import SPMMError
from ...runtime.device import full_precision
from .drawing import Drawing
from .lobe_cache import Stopped
from .page import Callbacks, build_page
from .preview import SIZE, Preview, jpeg_uri, png_uri
from .session import Session
from .sliders import SLIDERS
from .stage import Setting, first_setting

SETTINGS = ("shape", "repeat", "light_theta", "light_phi", "view_theta", "view_phi")
# Seconds without a change after which pictures become smooth.
PAUSE = 0.25


def answered(action: Callable[..., None]) -> Callable[..., None]:
    """A callback of the page: an error is shown there, and the pictures are rendered anew."""

    @wraps(action)
    def answer(self: EditorApp, *arguments: Any) -> None:
        self.say("")
        try:
            action(self, *arguments)
        except SPMMError as error:
            self.say(f"{error}", wrong=True)
        self.show_session()
        self.render_anew()

    return answer


class EditorApp:
    """One session in one page.

    Args:
        session: the run that is edited.
        folder: of the pictures of painted selections, as long as the editor runs.
        save_name: the proposed name of the folder to save as.
        size: pixels along each side of the pictures.
    """

    def __init__(
        self, session: Session, folder: Path, save_name: str = "", size: int = SIZE
    ) -> None:
        self.session, self.drawing = session, Drawing(session, folder)
        self.preview = Preview(session.original, first_setting(session.original), size)
        self.server = _new_server(f"spmm_edit_{id(self)}")
        self.state = self.server.state
        self.changed = asyncio.Event()
        self._fill_state(save_name)
        self._connect()
        build_page(self.server, self._callbacks())

    def run(self, host: str, port: int, open_browser: bool) -> None:
        """Serves the page until the process is stopped."""
        if open_browser:
            address = f"http://{host}:{port}/"
            self.server.controller.on_server_ready.add(lambda **_: _show_in_browser(address))
        try:
            self.server.start(
                host=host,
                port=port,
                open_browser=False,  # trame's way tells of an option that is none of ours
                show_connection_info=False,
                timeout=0,
            )
        finally:
            self.changed.set()  # ends the picture that the process would wait for

    def render_anew(self) -> None:
        """Asks for pictures of what is there now."""
        self.state.busy = True
        self.changed.set()

    def say(self, text: str, wrong: bool = False) -> None:
        """Shows a sentence under the title."""
        self.state.message, self.state.wrong = text, wrong

    @answered
    def undo(self) -> None:
        """Takes back the last edit."""
        self.session.undo()

    @answered
    def redo(self) -> None:
        """Makes the last edit again that was taken back."""
        self.session.redo()

    @answered
    def reset(self) -> None:
        """Removes all edits."""
        self.session.reset()

    @answered
    def add(self) -> None:
        """Adds the edit that was typed."""
        self.session.add(self.state.typed)
        self.state.typed = ""

    @answered
    def save(self) -> None:
        """Saves the edited run under the name on the page."""
        self.session.save(self.state.save_name)
        self.say(f"saved as {self.state.save_name}")

    @answered
    def release(self, name: str, value: float) -> None:
        """Ends the move of a slider, whose last value the page may tell later than this."""
        self.session.move(name, float(value))
        self.session.release()

    @answered
    def choose_tool(self, tool: str) -> None:
        """Takes another tool of the selection."""
        self.state.tool = tool
        self.drawing.choose(tool)

    @answered
    def press(self, x: float, y: float) -> None:
        """Begins a stroke where the pointer went down on the texture."""
        self.drawing.brush = float(self.state.brush)
        self.drawing.press((x, y))

    @answered
    def drag(self, x: float, y: float) -> None:
        """Continues the stroke."""
        self.drawing.drag((x, y))

    @answered
    def drop(self, x: float, y: float) -> None:
        """Ends the stroke and selects what it drew."""
        self.drawing.drop((x, y))

    def show_session(self) -> None:
        """Brings the page in step with the session."""
        session, state = self.session, self.state
        state.update(session.values)
        state.update({"can_undo": session.can_undo, "can_redo": session.can_redo})
        state.script = session.script.to_yaml() if session.script.steps else ""
        where = "the whole texture" if session.mask is None else "the selection"
        state.selected = f"Edits of {where}"
        state.slice_image = png_uri(self.drawing.picture())

    def _callbacks(self) -> Callbacks:
        return Callbacks(**{each.name: getattr(self, each.name) for each in fields(Callbacks)})

    def _fill_state(self, save_name: str) -> None:
        """Gives every variable of the page its first value."""
        setting = self.preview.setting
        name = self.session.original.name or self.session.run.name
        (light_theta, light_phi), (view_theta, view_phi) = setting.light, setting.view
        self.state.update(
            {
                "trame__title": f"{name} · spmm edit",
                "title": f"{name}, {self.session.original.width} × {self.session.original.height}",
                "save_name": save_name,
                "typed": "",
                "tool": self.drawing.tool,
                "brush": self.drawing.brush,
                "shape": setting.shape,
                "repeat": setting.repeat,
                "light_theta": light_theta,
                "light_phi": light_phi,
                "view_theta": view_theta,
                "view_phi": view_phi,
                "usable": self.session.usable(),
                "busy": True,
                "original_image": jpeg_uri(self.preview.original),
                "edited_image": jpeg_uri(self.preview.original),
            }
        )
        self.say("")
        self.show_session()

    def _connect(self) -> None:
        """Connects the events of the page to their callbacks."""
        self.state.change(*(slider.name for slider in SLIDERS))(self._on_sliders)
        self.state.change(*SETTINGS)(self._on_setting)
        for name in ("press", "drag", "drop"):
            self.server.trigger(name)(getattr(self, name))
        self.server.controller.on_server_ready.add(self._start_worker)

    def _start_worker(self, **_: Any) -> None:
        self._worker = asyncio.get_running_loop().create_task(self._work())
        self._worker.add_done_callback(lambda task: task.result())  # raises what the worker raised
        self.changed.set()

    def _on_sliders(self, **_: Any) -> None:
        """Moves each slider of the session to where the user moved it on the page."""
        for name, value in self.session.values.items():
            if self.state[name] != value:
                self._move(name, float(self.state[name]))

    @answered
    def _move(self, name: str, value: float) -> None:
        self.session.move(name, value)

    def _on_setting(self, **_: Any) -> None:
        self.render_anew()

    def _setting(self) -> Setting:
        """Shape, light and view on the page."""
        shape, repeat, *angles = (self.state[name] for name in SETTINGS)
        light_theta, light_phi, view_theta, view_phi = map(float, angles)
        return Setting(shape, float(repeat), (light_theta, light_phi), (view_theta, view_phi))

    async def _work(self) -> None:
        """Renders the newest state, over and over."""
        finished = True
        while True:
            try:
                await asyncio.wait_for(self.changed.wait(), None if finished else PAUSE)
            except TimeoutError:
                finished = await self._show(self._finish)
            else:
                self.changed.clear()
                finished = await self._show(self._follow)

    async def _show(self, pictures: Callable[[], dict[str, str]]) -> bool:
        """Renders in another thread and shows the pictures; True once nothing is left to do."""
        try:
            images = await asyncio.get_running_loop().run_in_executor(None, pictures)
        except Stopped:
            return False
        except SPMMError as error:
            images = {}
            self.say(f"{error}", wrong=True)
        finished = pictures == self._finish
        with self.state:
            self.state.update(images)
            self.state.busy = not finished or self.changed.is_set()
        return finished

    def _follow(self) -> dict[str, str]:
        """The pictures that changed, as fast as a dragged slider needs them."""
        setting, images = self._setting(), {}
        with full_precision():
            if setting != self.preview.setting:
                self.preview.set(setting)
                images["original_image"] = jpeg_uri(self.preview.original)
            codes = self.preview.follow(self.session.model())
        return images | {"edited_image": jpeg_uri(codes)}

    def _finish(self) -> dict[str, str]:
        """Both pictures, smooth; raises `Stopped` as soon as something changes."""
        model = self.session.model()
        with full_precision():
            codes = self.preview.finish(model, self.changed.is_set)
        return {
            "original_image": jpeg_uri(self.preview.original),
            "edited_image": jpeg_uri(codes),
        }


def _show_in_browser(address: str) -> None:
    """Opens the page in a browser, in a thread: browsers in a terminal end when they are closed."""
    Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def _new_server(name: str) -> Any:
    """A trame server; `Any`, because trame does not type its state and controller."""
    from trame.app import get_server

    return get_server(name, client_type="vue3")
