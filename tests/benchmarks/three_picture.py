"""A picture by three.js of the glTF export: `python -m tests.benchmarks.three_picture RUN`.

Needs `node_modules` by `npm install three`, here or where `--modules` says; Chromium draws. A plane
of one texture under a sun, seen slantwise by parallel rays: the relative error of the picture
against the equations of glTF as `spmm export` measures them.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import torch
from torch import Tensor

from spmm_torch.export.gltf import write
from spmm_torch.export.surface.textured import Textured
from spmm_torch.export.target import NoSettings
from spmm_torch.runtime.progress import Progress
from tests.browser import WEBGL, browser
from tests.slant_view import (
    DISTANCE,
    SIZE,
    WIDTH,
    add_model,
    light_and_view,
    model_of,
    seen,
    told,
)

PAGE = Path(__file__).with_name("three_page.html")
THREE = "node_modules/three/build/three.module.js"
PATIENCE = 120.0  # seconds for a page on a busy machine
ASK = """
const answer = arguments[arguments.length - 1];
const ask = () => window.picture
    ? window.picture(arguments[0]).then(answer, (error) => answer({ error: String(error) }))
    : setTimeout(ask, 100);
ask();
"""


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a line for each."""

    def log_message(self, format: str, *args: object) -> None:
        """Says nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder, which a page may load modules from."""
    handler = partial(QuietHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


def picture(folder: Path, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """(the picture `[S, S, 3]` by three.js, uv `[S, S, 2]` of its pixels).

    Args:
        folder: holds `material.glb`, `three_page.html` and `node_modules`.
        wi, wo: directions of the sun and of the camera, `[3]`.
    """
    facts = {"size": SIZE, "width": WIDTH, "distance": DISTANCE}
    with served(folder) as address, browser(*WEBGL) as driver:
        driver.set_script_timeout(PATIENCE)
        driver.get(f"{address}/{PAGE.name}")
        answer = driver.execute_async_script(ASK, facts | {"wi": wi.tolist(), "wo": wo.tolist()})
        log = driver.get_log("browser")
    if "pixels" not in answer:
        raise RuntimeError(f"three.js drew nothing: {answer}, {log}")
    pixels = torch.tensor(answer["pixels"]).view(SIZE, SIZE, 4)
    camera = torch.tensor(answer["camera"]).view(4, 4).T
    return pixels[..., :3].flip(0), seen(camera, wo)


def main() -> None:
    """Prints the error."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_model(parser)
    parser.add_argument("--modules", type=Path, default=".", help="folder with node_modules")
    options = parser.parse_args()
    if not (options.modules / THREE).is_file():
        parser.error(f"{options.modules / THREE} is missing; run `npm install three` there")
    model, (wi, wo) = model_of(options), light_and_view()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "node_modules").symlink_to((options.modules / "node_modules").resolve())
        (folder / PAGE.name).write_bytes(PAGE.read_bytes())
        path = folder / "material.glb"
        material = write(path, model, NoSettings(), Progress(enabled=False)).material
        assert isinstance(material, Textured)
        found, uv = picture(folder, wi, wo)
    expected = material(uv, wi, wo) / material.gain  # a file of glTF knows no gain
    print(told("three.js against the equations of glTF", found, expected))


if __name__ == "__main__":
    main()
