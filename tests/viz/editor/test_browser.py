"""The editor in a real browser: what a user does first, from opening to a saved run."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.edit import Script
from tests.browser import MISSING, browser

CODE = "import sys; from spmm_torch.cli.main import main; sys.exit(main(sys.argv[1:]))"
# A busy machine starts a browser slowly; nothing here waits longer than it must.
PATIENCE = 60.0

pytestmark = pytest.mark.slow


def until(condition: Callable[[], Any]) -> Any:
    """Waits for something to be true, and returns it."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.1)
    raise AssertionError("it did not come true in time")


@pytest.fixture
def address(run: Path, tmp_path: Path) -> Iterator[str]:
    """An editor on the run that would save as `run2`."""
    for package in ("selenium", "trame", "trame_vuetify"):
        pytest.importorskip(package)
    if MISSING:
        pytest.skip(MISSING)
    options = ["--interactive", "--no-browser", "--size", "96", "-o", str(tmp_path / "run2")]
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, "edit", str(run), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    with process:  # waits for its end, whatever fails
        try:
            assert process.stdout is not None
            found = re.search(r"http://localhost:\d+/", process.stdout.readline())
            assert found is not None
            yield found[0]
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=PATIENCE)
            assert "Traceback" not in rest
        finally:
            process.kill()


@pytest.fixture
def page(address: str) -> Iterator[Any]:
    """The page in a headless browser."""
    with browser("disable-gpu", "window-size=1360,1040") as driver:
        until(lambda: _opened(driver, address))
        yield driver


def _opened(driver: Any, address: str) -> bool:
    """Whether the page is there; the server may still be starting."""
    from selenium.common.exceptions import WebDriverException

    try:
        if not driver.find_elements("id", "edited"):
            driver.get(address)
            time.sleep(1.0)
        return bool(driver.find_elements("id", "edited"))
    except WebDriverException:
        return False


def drag(page: Any, name: str, distance: int) -> None:
    """Drags the thumb of a slider to the right, in steps as a hand does."""
    from selenium.webdriver import ActionChains

    thumb = page.find_element("css selector", f".row:has(#slider_{name}) .v-slider-thumb")
    actions = ActionChains(page, duration=40).click_and_hold(thumb)
    for _ in range(4):
        actions = actions.move_by_offset(distance // 4, 0)
    actions.release().perform()


def settled(page: Any, name: str) -> str:
    """The picture once the page says that it is smooth, and of what the sliders say."""
    element = page.find_element("id", name)
    until(lambda: element.get_attribute("aria-busy") == "false")
    return picture(page, name)


def picture(page: Any, name: str) -> str:
    return page.find_element("id", name).get_attribute("src")


def text(page: Any, name: str) -> str:
    return page.find_element("id", name).text


def click(page: Any, name: str) -> None:
    page.find_element("id", name).click()


def test_a_session_in_the_browser(page: Any, run: Path, tmp_path: Path) -> None:
    first = settled(page, "edited")
    original = picture(page, "original")
    assert first == original

    drag(page, "intensity", 24)
    until(lambda: text(page, "script").startswith("- intensity:"))
    until(lambda: settled(page, "edited") != first)
    assert picture(page, "original") == original
    brighter, script = settled(page, "edited"), text(page, "script")

    click(page, "undo")
    until(lambda: text(page, "script") == "no edits yet")
    assert settled(page, "edited") == first
    click(page, "redo")
    until(lambda: text(page, "script") == script)
    assert settled(page, "edited") == brighter

    plain = picture(page, "slice")
    click(page, "tool_rectangle")
    select_quarter(page)
    until(lambda: picture(page, "slice") != plain)
    drag(page, "hue", 24)
    until(lambda: "rectangle:" in text(page, "script"))

    click(page, "shape_cloth")
    until(lambda: picture(page, "original") != original)
    click(page, "save")
    until(lambda: text(page, "message").startswith("saved as"))
    saved = SPMM.load(tmp_path / "run2")
    steps = Script.read(tmp_path / "run2" / "edits.yaml")
    assert [step.name for step in steps.steps] == ["intensity", "hue_saturation"]
    expected = steps.apply(SPMM.load(run))
    assert torch.equal(saved.weight, expected.weight)

    shown = text(page, "script")
    drag(page, "hue", -24)
    until(lambda: text(page, "script") != shown and text(page, "message") == "")
    settled(page, "edited")
    click(page, "save")  # what this session has saved is replaced
    until(lambda: text(page, "message").startswith("saved as"))
    again = Script.read(tmp_path / "run2" / "edits.yaml")
    assert again.to_yaml() != steps.to_yaml()


def test_two_browsers_edit_the_same_session(
    page: Any, address: str, run: Path, tmp_path: Path
) -> None:
    """Each sees what the other does, and one goes on where the other is closed."""
    settled(page, "edited")
    with browser("disable-gpu", "window-size=1360,1040") as other:
        until(lambda: _opened(other, address))
        drag(page, "intensity", 24)
        until(lambda: text(other, "script").startswith("- intensity:"))
        drag(other, "hue", 24)
        until(lambda: "hue_saturation:" in text(page, "script"))
        assert text(page, "script").startswith("- intensity:")
        until(lambda: settled(page, "edited") == settled(other, "edited"))
    click(page, "save")
    until(lambda: text(page, "message").startswith("saved as"))
    steps = Script.read(tmp_path / "run2" / "edits.yaml")
    assert [step.name for step in steps.steps] == ["intensity", "hue_saturation"]
    expected = steps.apply(SPMM.load(run))
    assert torch.equal(SPMM.load(tmp_path / "run2").weight, expected.weight)


def test_keys_undo_and_redo(page: Any) -> None:
    settled(page, "edited")
    drag(page, "intensity", 24)
    until(lambda: text(page, "script").startswith("- intensity:"))
    settled(page, "edited")
    press(page, "z")
    until(lambda: text(page, "script") == "no edits yet")
    press(page, "y")
    until(lambda: text(page, "script").startswith("- intensity:"))


def test_sliders_have_room_in_a_narrow_window(page: Any) -> None:
    page.set_window_size(1024, 900)
    until(lambda: page.execute_script("return window.innerWidth") <= 1024)
    tracks = page.find_elements("css selector", ".row .v-slider-track")
    assert len(tracks) > 10
    assert min(track.size["width"] for track in tracks) > 100
    width = page.execute_script("return document.documentElement.scrollWidth - window.innerWidth")
    assert width <= 0  # nothing beyond the window


def press(page: Any, key: str) -> None:
    """Presses a key together with Ctrl."""
    from selenium.webdriver import ActionChains, Keys

    ActionChains(page).key_down(Keys.CONTROL).send_keys(key).key_up(Keys.CONTROL).perform()


def select_quarter(page: Any) -> None:
    """Drags a rectangle over the middle of the texture."""
    from selenium.webdriver import ActionChains

    texture = page.find_element("id", "slice")
    page.execute_script("arguments[0].scrollIntoView()", texture)
    actions = ActionChains(page, duration=40).move_to_element_with_offset(texture, -50, -50)
    actions.click_and_hold().move_by_offset(50, 50).move_by_offset(50, 50).release().perform()
