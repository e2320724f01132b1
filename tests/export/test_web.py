"""The page of a model: it holds the model file, and its shader evaluates as Python does."""

from __future__ import annotations

import base64
import re
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.edit import intensity, lobe_group, relief_depth, residual_strength, scale_width
from spmm_torch.edit.parts import with_parts
from spmm_torch.errors import OutputError
from spmm_torch.export import TARGETS, NoSettings, glsl
from spmm_torch.export.loss import random_queries
from spmm_torch.export.web import page_text
from spmm_torch.export.written import export
from spmm_torch.geometry.directions import MIRROR, ring_directions
from spmm_torch.model.relief import Relief
from spmm_torch.runtime.progress import Progress
from tests.browser import MISSING, WEBGL
from tests.browser import browser as headless
from tests.planted.models import planted_relief, uneven_model, with_components, with_relief

PATIENCE = 120.0  # seconds for a page on a busy machine
QUERIES = 10_000
# Bytes of the page beside the model: scripts, shaders, styles.
PAGE_BYTES = 36_000
RINGS = ((0.0, 1), (25.0, 6), (50.0, 12), (75.0, 18))
DIRECTIONS = ring_directions(RINGS)
# Reads of a lobe: its entry, and three texels of frame and parameters.
READS_OF_A_LOBE = 4


def mixed_model() -> SPMM:
    """All BRDFs, smooth ends, residuals of both kinds, a mirrored relief of 6 x 8 texels."""
    counts = [(5 * n) % 7 for n in range(48)]
    model = with_components(uneven_model(counts, 6, DIRECTIONS, DIRECTIONS), rank=5, beside=True)
    model = with_parts(model, lobes=replace(model.dictionary.detach(), horizon=0.035))
    return with_relief(model, planted_relief(6, 8, 0.12, MIRROR, torch.zeros(len(DIRECTIONS), 2)))


def flat_model() -> SPMM:
    """Sharp ends, functions of 18 halves, a plane over that of the pictures, one view only."""
    view = ring_directions(((0.0, 1),))
    model = uneven_model([3] * 12, 3, DIRECTIONS, view)
    model = with_components(model, rank=18, dtype=torch.float16)
    return with_relief(model, Relief(None, 0.0, 0.04))


def clusters_model() -> SPMM:
    """A residual of clusters in floats, and no relief."""
    return uneven_model([2] * 20, 5, DIRECTIONS, DIRECTIONS, 4, precision=torch.float32)


MODELS = {"mixed": mixed_model, "flat": flat_model, "clusters": clusters_model}


@cache
def text_of(name: str) -> str:
    return page_text(MODELS[name]())


def held(text: str, name: str) -> bytes:
    """The model file, or the texts, that a page holds."""
    found = re.search(rf'id="{name}">([A-Za-z0-9+/=]+)<', text)
    assert found is not None
    return zlib.decompress(base64.b64decode(found[1]))


@pytest.mark.parametrize("name", MODELS)
def test_the_page_holds_the_model_file(name: str) -> None:
    found = safetensors.torch.load(held(text_of(name), "model"))
    tensors = MODELS[name]().to_tensors()[0]
    tensors.pop("relief.drift", None)
    for key, tensor in tensors.items():
        torch.testing.assert_close(found.pop(key), tensor, rtol=0.0, atol=0.0)
    assert set(found) == {"page.specular", "page.light_cells", "page.view_cells"}


@pytest.mark.parametrize("name", MODELS)
def test_a_page_is_little_more_than_its_model(name: str) -> None:
    text = text_of(name)
    assert len(text.encode()) <= 1.5 * len(MODELS[name]().pack()) + PAGE_BYTES


def test_the_page_asks_for_nothing_from_outside() -> None:
    text = text_of("mixed")
    assert "default-src 'none'" in text
    for part in (text, held(text, "texts").decode()):
        assert not re.search(r"https?:|//cdn|@import|url\(|<link|\bsrc=|fetch\(", part)


def test_the_name_of_a_material_is_text() -> None:
    model = uneven_model([1], 1, DIRECTIONS, DIRECTIONS, name="<script>alert(1)</script>")
    assert "<script>alert" not in page_text(model)


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_every_brdf_has_glsl(name: str) -> None:
    assert f"float {name}(vec3 kappa, vec3 wi, vec3 wo)" in glsl.brdf(name)


def test_a_brdf_without_glsl_is_named() -> None:
    with pytest.raises(OutputError, match=r"BRDF minnaert.*expected web_page/glsl/lobes/minnaert"):
        glsl.brdf("minnaert")


def test_reads_of_a_lobe() -> None:
    entry = glsl.glsl("mixture.glsl").count("place(int(entry))")
    assert entry + glsl.glsl("frame.glsl").count("texelFetch") == READS_OF_A_LOBE


def test_the_export_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "x.html"
    outcome = export(clusters_model(), TARGETS["web"], path, NoSettings(), Progress(enabled=False))
    assert outcome.left_out == ()
    assert path.read_text(encoding="utf-8") == text_of("clusters")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    pytest.importorskip("selenium", reason="needs selenium")
    if MISSING:
        pytest.skip(MISSING)
    with headless(*WEBGL, "window-size=320,320") as driver:  # small pictures are cheap
        yield driver


def opened(browser: Any, name: str, folder: Path) -> None:
    """Opens the page of a model and waits until it can be asked."""
    path = folder / f"{name}.html"
    path.write_text(text_of(name), encoding="utf-8")
    browser.get(path.as_uri())
    end = time.monotonic() + PATIENCE
    ready = "return document.body.dataset.ready"
    while time.monotonic() < end and not browser.execute_script(ready):
        time.sleep(0.05)
    trouble = browser.find_element("id", "trouble").text
    if "WebGL 2" in trouble:
        pytest.skip("needs a browser with WebGL 2")
    assert not trouble


def in_browser(browser: Any, queries: tuple[Tensor, ...]) -> Tensor:
    """Values `[Q, 3]` of queries by the page that is open."""
    numbers = torch.cat(queries, dim=1).flatten().tolist()
    values = browser.execute_script("return [...spmm.evaluate(arguments[0])]", numbers)
    return torch.tensor(values, dtype=torch.float64).view(-1, 3)


def many_queries(model: SPMM) -> tuple[Tensor, ...]:
    """Random queries over some copies of the texture, and all measured pairs of directions."""
    uv, wi, wo = random_queries(QUERIES)
    pairs = torch.cartesian_prod(torch.arange(len(model.light)), torch.arange(len(model.view)))
    pairs = pairs[: QUERIES // 4]
    wi = torch.cat((wi[len(pairs) :], model.light[pairs[:, 0]]))
    wo = torch.cat((wo[len(pairs) :], model.view[pairs[:, 1]]))
    return 4.0 * uv - 1.5, wi, wo


@torch.no_grad()
def relative_errors(values: Tensor, model: SPMM, queries: tuple[Tensor, ...]) -> Tensor:
    """Errors `[Q]` relative to exact values, or to a hundredth of their mean where less."""
    exact = model.double()
    exact.checks_queries = False
    expected = exact(*(part.double() for part in queries))
    size = expected.abs().clamp(min=0.01 * float(expected.abs().mean()))
    return ((values - expected).abs() / size).amax(dim=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_the_shader_evaluates_as_python_does(browser: Any, name: str, tmp_path: Path) -> None:
    model = MODELS[name]()
    queries = many_queries(model)
    in_python = model(*queries).double()
    opened(browser, name, tmp_path)
    values = in_browser(browser, queries)
    rounding = relative_errors(in_python, MODELS[name](), queries)
    errors = relative_errors(values, MODELS[name](), queries)
    assert values.abs().sum() > 0.0
    assert errors.median() < 2e-6
    assert errors.quantile(0.999) < max(2e-4, 3.0 * float(rounding.quantile(0.999)))
    assert not [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


EDITS: dict[str, tuple[dict[str, float], Callable[[SPMM], SPMM]]] = {
    "specular": (
        {"specular": 0.5, "specular_width": 1.0},
        lambda model: scale_width(
            intensity(model, 0.5, lobe_group(model, "specular")),
            2.0,
            lobe_group(model, "specular"),
        ),
    ),
    "diffuse": (
        {"diffuse": 2.0},
        lambda model: intensity(model, 2.0, lobe_group(model, "non_specular")),
    ),
    "residual": ({"residual": 0.25}, lambda model: residual_strength(model, 0.25)),
    "relief": ({"depth": 2.0}, lambda model: relief_depth(model, 2.0)),
}
SET = """
const input = document.querySelector(`input[name="${arguments[0]}"]`);
input.value = arguments[1];
input.dispatchEvent(new Event("input"));
"""


@pytest.mark.slow
def test_sliders_do_what_edits_do(browser: Any, tmp_path: Path) -> None:
    queries = tuple(part[:500] for part in random_queries(500))
    opened(browser, "mixed", tmp_path)
    for sliders, edit in EDITS.values():
        for slider in sliders.items():
            browser.execute_script(SET, *slider)
        errors = relative_errors(in_browser(browser, queries), edit(mixed_model()), queries)
        assert errors.median() < 2e-6
        assert errors.quantile(0.99) < 1e-3
        browser.execute_script("document.getElementById('start_again').click()")
    errors = relative_errors(in_browser(browser, queries), mixed_model(), queries)
    assert errors.median() < 2e-6
