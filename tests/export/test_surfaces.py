"""glTF and OpenPBR files: judged by programs of their standards, and read back."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch import SPMM
from spmm_torch.export import TARGETS, NoSettings
from spmm_torch.export.surface import fit
from spmm_torch.export.surface.gltf import GLTFSurface
from spmm_torch.export.surface.openpbr import OpenPBRSurface
from spmm_torch.export.textures import Plane, axis_planes, decode_display, normal_planes
from spmm_torch.export.written import export
from spmm_torch.render import Sphere, Texture, encode_display
from spmm_torch.runtime.progress import Progress
from tests.planted.models import planted_model, with_relief

QUIET = Progress(enabled=False)
VALIDATE = """
const fs = require('fs');
require('gltf-validator').validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then(report => console.log(JSON.stringify(report)));
"""


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every layer is written, whether it pays or not, after few steps."""
    monkeypatch.setattr(fit, "PAYS", -1e9)
    monkeypatch.setattr(fit, "STEPS", 6)


def written(model: SPMM, target: str, path: Path) -> Path:
    export(model, TARGETS[target], path, NoSettings(), QUIET)
    return path


def parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the buffer of a .glb file."""
    content = path.read_bytes()
    assert content[:4] == b"glTF"
    assert int.from_bytes(content[8:12], "little") == len(content)
    size = int.from_bytes(content[12:16], "little")
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def test_gltf_has_every_layer(tmp_path: Path) -> None:
    document, _ = parts(written(planted_model(size=4), "gltf", tmp_path / "x.glb"))
    (material,) = document["materials"]
    used = {f"KHR_materials_{layer}" for layer in GLTFSurface.layers}
    assert set(document["extensionsUsed"]) == set(material["extensions"]) == used
    coat = material["extensions"]["KHR_materials_clearcoat"]
    assert coat["clearcoatNormalTexture"] == material["normalTexture"]
    assert "extensionsRequired" not in document


def test_gltf_is_valid(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    path = written(planted_model(size=4), "gltf", tmp_path / "x.glb")
    result = subprocess.run(
        [node, "-e", VALIDATE, str(path)], capture_output=True, text=True, check=False
    )
    if "Cannot find module" in result.stderr:
        pytest.skip("needs gltf-validator where node finds it: npm install gltf-validator")
    report = json.loads(result.stdout)
    assert report["issues"]["numErrors"] == report["issues"]["numWarnings"] == 0, report["issues"]
    assert report["info"]["materialCount"] == 1


def test_gltf_lies_as_the_sphere_does(tmp_path: Path) -> None:
    """uv and tangents of the mesh against those of `render.Sphere`."""
    document, buffer = parts(written(planted_model(size=4), "gltf", tmp_path / "x.glb"))
    (primitive,) = document["meshes"][0]["primitives"]

    def rows(accessor: int, kind: str) -> np.ndarray:
        each = document["accessors"][accessor]
        view = document["bufferViews"][each["bufferView"]]
        start = view["byteOffset"]
        return np.frombuffer(buffer[start : start + view["byteLength"]], kind).reshape(
            each["count"], -1
        )

    read = {name: rows(n, "<f4") for name, n in primitive["attributes"].items()}
    corners = rows(primitive["indices"], "<u2").reshape(-1, 3)
    a, b, c = (torch.from_numpy(read["POSITION"][corners[:, n]].copy()) for n in range(3))
    area = torch.linalg.cross(b - a, c - a)
    assert float((area * (a + b + c)).sum(-1).min()) > 0.0
    inner = np.abs(read["POSITION"][:, 1]) < 0.999
    inner &= np.abs(np.arctan2(read["POSITION"][:, 0], read["POSITION"][:, 2])) < 3.14
    place = torch.from_numpy(read["POSITION"][inner])
    frame, uv = Sphere(Texture(32.0, 1.0)).surface(place)
    np.testing.assert_allclose(read["TANGENT"][inner, :3], frame[:, 0], atol=1e-5)
    np.testing.assert_allclose(read["TEXCOORD_0"][inner, 0], uv[:, 0], atol=1e-4)
    np.testing.assert_allclose(1.0 - read["TEXCOORD_0"][inner, 1], uv[:, 1], atol=1e-4)


def test_gltf_pictures_are_the_parameters(tmp_path: Path) -> None:
    model = planted_model(size=4)
    document, buffer = parts(written(model, "gltf", tmp_path / "x.glb"))
    by_name = {}
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        payload = buffer[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        by_name[image["name"]] = np.asarray(Image.open(io.BytesIO(payload)))
    fitted = fit.fit_surface(GLTFSurface(), fit.look_of(model), QUIET)
    codes = by_name["base_color"].reshape(16, 3) / 255.0
    read = decode_display(torch.from_numpy(codes))
    torch.testing.assert_close(read.float(), fitted.values["base_color"], atol=0.01, rtol=0)
    orm = by_name["metallic_roughness"].reshape(16, 3) / 255.0
    rough, metallic = (fitted.values[name][:, 0] for name in ("roughness", "metallic"))
    np.testing.assert_allclose(orm[:, 1], rough, atol=0.003)
    np.testing.assert_allclose(orm[:, 2], metallic, atol=0.003)


def test_openpbr_is_valid(tmp_path: Path) -> None:
    mx = pytest.importorskip("MaterialX", reason="needs materialx")
    folder = written(with_relief(planted_model(size=4)), "openpbr", tmp_path / "x")
    document, library = mx.createDocument(), mx.createDocument()
    mx.readFromXmlFile(document, str(folder / "material.mtlx"))
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.setDataLibrary(library)
    valid, complaint = document.validate()
    assert valid, complaint
    (surface,) = document.getNodes("open_pbr_surface")
    known = {each.getName() for each in surface.getNodeDef().getActiveInputs()}
    assert {each.getName() for each in surface.getInputs()} <= known
    (material,) = document.getMaterialNodes()
    assert material.getInput("displacementshader") is not None
    named = [each.getValueString() for each in document.traverseTree() if is_file(each)]
    assert {folder / name for name in named} | {folder / "material.mtlx"} == set(folder.iterdir())


def is_file(element: object) -> bool:
    return getattr(element, "getType", lambda: "")() == "filename"


def test_openpbr_has_a_texture_for_each_parameter(tmp_path: Path) -> None:
    folder = written(planted_model(size=4), "openpbr", tmp_path / "x")
    root = ElementTree.parse(folder / "material.mtlx").getroot()
    surface = root.find("open_pbr_surface")
    assert surface is not None
    inputs = {each.get("name"): each for each in surface}
    surfaces = OpenPBRSurface()
    names = {each.name for each in fit.parameters_of(surfaces, tuple(surfaces.layers))}
    names -= {"normal", "anisotropy"}
    names |= {"geometry_normal", "geometry_coat_normal", "geometry_tangent"}
    assert names | {"specular_roughness_anisotropy"} <= set(inputs)
    assert root.find("displacement") is None
    assert float(inputs["coat_darkening"].get("value", "")) == 0.0


def test_planes_are_read_as_they_are_coded() -> None:
    values = torch.rand(50, 3, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(decode_display(encode_display(values)), values)
    assert float((Plane.colour(values).read - values).abs().max()) < 0.006
    assert float((Plane.linear(values).read - values).abs().max()) <= 0.5 / 255 + 1e-6
    factor = torch.tensor([4.0, 0.5, 2.0])
    read = Plane.colour(values * factor, factor).read
    assert float(((read - values * factor) / factor).abs().max()) < 0.006
    slope = 0.5 * (values[:, :2] - 0.5)
    normal = normal_planes(slope).read
    torch.testing.assert_close(normal.norm(dim=1), torch.ones(50), atol=0.01, rtol=0)


def test_neighbouring_axes_point_the_same_way() -> None:
    angle = torch.linspace(1.4, 1.75, 9)  # about a quarter turn, where arctangents jump
    vector = 0.8 * torch.stack((torch.cos(2 * angle), torch.sin(2 * angle)), dim=1)
    direction, strength = axis_planes(vector)
    assert float((direction.read[1:] * direction.read[:-1]).sum(1).min()) > 0.9
    torch.testing.assert_close(strength.read, torch.full((9, 1), 0.8), atol=0.003, rtol=0)
    expected = torch.stack((torch.cos(angle), torch.sin(angle)), dim=1)
    sign = torch.sign((direction.read[:1] * expected[:1]).sum())
    torch.testing.assert_close(direction.read, sign * expected, atol=0.01, rtol=0)
