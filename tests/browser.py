"""Headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
MISSING = "needs chromium and chromedriver" if CHROMIUM is None or DRIVER is None else None
FLAGS = ("headless=new", "no-sandbox", "disable-dev-shm-usage")
# Software draws WebGL where there is no graphics card.
WEBGL = ("use-gl=angle", "use-angle=swiftshader", "enable-unsafe-swiftshader")


@contextmanager
def browser(*flags: str) -> Iterator[Any]:
    """A browser with further flags, which keeps its log."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, *flags):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        yield driver
    finally:
        driver.quit()
