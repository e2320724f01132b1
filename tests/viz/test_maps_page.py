"""The offline page of `spmm view --maps`, as a browser shows it."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch import SPMM
from spmm_torch.viz.html import save_html
from spmm_torch.viz.maps import maps_scene
from spmm_torch.viz.palette import PAGE
from tests.browser import MISSING, WEBGL, browser
from tests.viz.editor.test_browser import until

pytestmark = pytest.mark.slow
# Pixels along each border of the window that must be bare, and how far a code may be from bare.
MARGIN, TOLERANCE = 4, 3


@pytest.mark.parametrize("size", ["1360,900", "1024,900"])
def test_maps_are_seen_whole(model: SPMM, tmp_path: Path, size: str) -> None:
    for package in ("selenium", "pyvista", "trame_vtk"):
        pytest.importorskip(package)
    if MISSING:
        pytest.skip(MISSING)
    save_html(maps_scene(model), tmp_path / "maps.html")
    with browser(f"window-size={size}", *WEBGL) as driver:
        driver.get((tmp_path / "maps.html").as_uri())
        (shown,) = until(lambda: drawn(driver.get_screenshot_as_png()))
    columns = np.flatnonzero(shown.any(0))
    assert columns[0] >= MARGIN and columns[-1] < shown.shape[1] - MARGIN
    assert columns[-1] - columns[0] > 0.6 * shown.shape[1]


def drawn(screenshot: bytes) -> list[np.ndarray]:
    """Which pixels `[h, W]` under the legend are not bare; none of it while hardly any are."""
    with Image.open(io.BytesIO(screenshot)) as image:
        codes = np.asarray(image.convert("RGB")).astype(int)
    lower = codes[len(codes) // 3 :]
    bare = np.rint(255 * np.asarray(PAGE))
    shown = np.abs(lower - bare).max(2) > TOLERANCE
    return [shown] if shown.mean() > 0.05 else []
