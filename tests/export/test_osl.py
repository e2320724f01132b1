"""The shader of closures: nearest closures, foreign pictures, and a compiler that is not ours."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.export import TARGETS, NoSettings, closures
from spmm_torch.export.closure_fit import fitted
from spmm_torch.export.closures import KINDS
from spmm_torch.export.osl import MOST_CLOSURES, ClosureMaterial, slots_of, write
from spmm_torch.export.written import export
from spmm_torch.geometry.directions import MIRROR, direction_from_angles, ring_directions
from spmm_torch.geometry.warp import square_to_uniform_hemisphere
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.runtime.progress import Progress
from tests.benchmarks.cycles_picture import both_pictures
from tests.planted.models import planted_model, planted_relief, uneven_model, with_relief

QUIET = Progress(enabled=False)
DIRECTIONS = ring_directions(((0.0, 1), (40.0, 6)))
OSLC = shutil.which("oslc")


def relief_model() -> SPMM:
    """All BRDFs over a mirrored relief."""
    model = uneven_model([(3 * n) % 8 for n in range(30)], 5, DIRECTIONS, DIRECTIONS)
    return with_relief(model, planted_relief(5, 6, 0.1, MIRROR))


def pixels(path: Path) -> np.ndarray:
    """The four channels of a picture, by OpenEXR."""
    return OpenEXR.File(str(path)).channels()["RGBA"].pixels


def lobe(name: str, kappa: tuple[float, ...]) -> LobeBatch:
    """One lobe upright over the texel."""
    row = torch.zeros(1, 3)
    row[0, : len(kappa)] = torch.tensor(kappa)
    model = torch.tensor([MODEL_NAMES.index(name)])
    return LobeBatch(model, row, torch.tensor([[0.0, 0.0, 1.0]]), torch.zeros(1))


@pytest.mark.parametrize(
    ("name", "kappa", "kind"),
    [
        ("lambertian", (), "DIFFUSE"),
        ("ggx", (0.2, 0.4, 0.3), "SCHLICK_GGX"),
        ("cook_torrance", (0.2, 0.05), "SCHLICK_BECKMANN"),
    ],
)
def test_a_lobe_that_is_a_closure_stays_itself(
    name: str, kappa: tuple[float, ...], kind: str
) -> None:
    found = fitted(lobe(name, kappa))
    assert KINDS[int(found.kind)] == kind
    assert float(found.scale) == pytest.approx(1.0, abs=0.06)
    assert float(found.error) < 0.01
    for column, alpha in enumerate(kappa[:1]):
        assert float(found.parameters[0, column]) == pytest.approx(alpha, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_closures_reflect_no_more_than_comes(kind: str) -> None:
    u = torch.rand(1 << 14, 2, generator=torch.Generator().manual_seed(2))
    wi = square_to_uniform_hemisphere(u)
    wo = direction_from_angles(torch.tensor(0.6), torch.tensor(0.3)).expand_as(wi)
    parameters = torch.tensor([0.3, 0.5, 0.5, 0.7]).expand(len(wi), 4)
    number = torch.full((len(wi),), KINDS.index(kind))
    value = closures.value(number, parameters, wi, wo)
    assert value.isfinite().all()
    assert (value >= 0.0).all()
    assert 0.3 < 2.0 * torch.pi * float(value.mean()) < 1.05


def test_pictures_hold_lobes_and_weights(tmp_path: Path) -> None:
    model = relief_model()
    exported = write(tmp_path, model, NoSettings(), QUIET)
    assert isinstance(exported.material, ClosureMaterial)
    entries, lobes = pixels(tmp_path / "entries.exr"), pixels(tmp_path / "lobes.exr")
    entries = entries.reshape(-1, model.height, model.width, 4)  # slot, row, column
    texel = 13
    row, column = divmod(texel, model.width)
    part = slice(int(model.offset[texel]), int(model.offset[texel + 1]))
    held = {int(each[3]) - 1: each[:3] for each in entries[:, row, column] if each[3] > 0.0}
    expected = zip(model.index[part].tolist(), model.weight[part].detach().numpy(), strict=True)
    assert held.keys() == set(model.index[part].tolist())
    for index, weight in expected:
        np.testing.assert_array_equal(held[index], weight)
    np.testing.assert_array_equal(lobes[:, 1, :3], model.normal.detach().numpy())
    assert model.relief is not None
    heights = model.relief.height.detach().view(model.height, model.width)
    np.testing.assert_array_equal(pixels(tmp_path / "heights.exr")[..., 0], heights)


@pytest.mark.parametrize(("name", "most"), [("lambertian", 16), ("cook_torrance", 8)])
def test_lobes_beyond_those_that_are_kept_are_named(tmp_path: Path, name: str, most: int) -> None:
    model = planted_model(2, most + 3, lobes_per_cluster=20, names=(name,))
    slots = slots_of(model, fitted(model.dictionary.detach()))
    assert slots.lobe.shape == (4, most)
    weights = model.weight.detach().view(4, -1, 3).sum(-1)
    weakest = weights.sort(dim=1).values[:, :3].sum() / weights.sum()
    assert 0.0 < slots.lost == pytest.approx(float(weakest), rel=1e-4)
    assert float(slots.weight.sum(-1).min()) >= float(weights.sort(dim=1).values[:, 2].min())
    outcome = export(model, TARGETS["osl"], tmp_path / "x", NoSettings(), QUIET)
    assert any(f"its strongest {MOST_CLOSURES}" in clause for clause in outcome.left_out)


def test_the_sum_of_closures_nests_to_the_right(tmp_path: Path) -> None:
    """Cycles unfolds a sum from its left, and forgets what a stack of 16 does not hold."""
    write(tmp_path, relief_model(), NoSettings(), QUIET)
    text = (tmp_path / "spmm.osl").read_text(encoding="utf-8")
    assert "BSDF +=" not in text
    assert re.search(r"\+ BSDF;", text)


def test_what_closures_cannot_hold_is_named(tmp_path: Path) -> None:
    model = uneven_model([2, 1], 1, DIRECTIONS, DIRECTIONS, names=("lambertian", "lafortune"))
    outcome = export(model, TARGETS["osl"], tmp_path / "x", NoSettings(), QUIET)
    text = " ".join(outcome.left_out)
    assert "the residual" in text
    assert "the shape of lafortune lobes" in text
    assert "lambertian" not in text


def test_a_lambertian_material_is_held() -> None:
    model = planted_model(size=3, names=("lambertian",))
    found = fitted(model.dictionary.detach())
    material = ClosureMaterial(model, slots_of(model, found), found)
    uv = torch.rand(50, 2, generator=torch.Generator().manual_seed(4))
    wi = direction_from_angles(torch.tensor(0.2), torch.tensor(1.0))
    wo = direction_from_angles(torch.tensor(0.5), torch.tensor(4.0))
    expected = model(uv, wi, wo, residual=False)
    torch.testing.assert_close(material(uv, wi, wo), expected.detach(), rtol=1e-4, atol=1e-5)


def test_the_shader_has_the_numbers_of_the_model(tmp_path: Path) -> None:
    model = relief_model()
    write(tmp_path, model, NoSettings(), QUIET)
    text = (tmp_path / "spmm.osl").read_text(encoding="utf-8")
    numbers = dict(re.findall(r"#define (\w+) ([-\d.e]+)", text))
    assert (numbers["COLUMNS"], numbers["ROWS"], numbers["MIRROR"]) == ("6", "5", "1")
    assert [int(numbers[kind]) for kind in KINDS] == list(range(len(KINDS)))


@pytest.mark.skipif(OSLC is None, reason="needs oslc, the compiler of Open Shading Language")
def test_a_compiler_of_open_shading_language_takes_it(tmp_path: Path) -> None:
    write(tmp_path, relief_model(), NoSettings(), QUIET)
    # Declares what Blender's own header adds to that of the language.
    (tmp_path / "stdcycles.h").write_text('#include "stdosl.h"\n', encoding="utf-8")
    target = tmp_path / "spmm.oso"
    command = [str(OSLC), "-I", str(tmp_path), "-o", str(target), str(tmp_path / "spmm.osl")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "shader spmm" in target.read_text(encoding="utf-8")


def test_blender_compiles_the_shader(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="needs bpy, Blender as a module of Python")
    cycles = pytest.importorskip("_cycles", reason="needs bpy with Cycles")
    write(tmp_path, relief_model(), NoSettings(), QUIET)
    assert cycles.osl_compile(str(tmp_path / "spmm.osl"), str(tmp_path / "spmm.oso"))


@pytest.mark.parametrize(
    ("names", "lobes"), [(("ward", "ashikhmin_shirley"), 16), (("cook_torrance",), 8)]
)
def test_blender_shows_all_closures(names: tuple[str, ...], lobes: int) -> None:
    pytest.importorskip("bpy", reason="needs bpy, Blender as a module of Python")
    model = planted_model(8, lobes, lobes_per_cluster=20, names=names)
    wi, wo = (
        direction_from_angles(torch.tensor(theta), torch.tensor(phi))
        for theta, phi in ((0.5, 3.5), (0.4, 1.0))
    )
    found, expected = both_pictures(model, wi, wo)
    assert float((found - expected).norm() / expected.norm()) < 0.002
