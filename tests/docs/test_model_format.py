"""docs/model_format.md: its reader agrees with SPMM, and its tables name what there is."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.edit.parts import with_parts
from spmm_torch.geometry.directions import RULES, direction_from_angles
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.model.lookup import SparseWeights
from spmm_torch.model.stored_weights import GROUP, rounded
from tests.brdf.numpy_twins import twin_of
from tests.docs.markdown import blocks, table
from tests.locations import DOCS
from tests.planted.models import planted_model, planted_relief, with_components, with_relief

PAGE = DOCS / "model_format.md"
QUERIES = 400
# Narrow types of indices, as the table calls them.
INDEX = ("U8", "I16", "I32")


@pytest.fixture(scope="module")
def reader() -> dict[str, Any]:
    """The reader of the page, knowing all BRDFs by their NumPy twins."""
    (block,) = blocks(PAGE, "python")
    names: dict[str, Any] = {}
    exec(compile(block.text, PAGE.name, "exec"), names)
    own = set(names["BRDFS"])
    for brdf in REGISTRY:
        if brdf.name not in own:
            names["BRDFS"][brdf.name] = twin(brdf.name, len(brdf.parameters))
    assert own == {"lambertian", "ward"}
    return names


def twin(name: str, parameters: int) -> Any:
    """The twin of a BRDF, which takes no more parameters than it has."""
    return lambda kappa, wi, wo: twin_of(name)(kappa[:parameters].astype(float), wi, wo)


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file with a lobe of every BRDF in each cluster, and a residual."""
    model = planted_model(
        lobes_per_texel=4, lobes_per_cluster=len(MODEL_NAMES), names=MODEL_NAMES, residual=0.1
    )
    path = tmp_path_factory.mktemp("planted") / "model.safetensors"
    path.write_bytes(model.pack())
    return path


def version_2(planted: SPMM, weight_type: torch.dtype, beside: bool) -> SPMM:
    """The model with components, weights on a logarithmic scale, and lobes in groups."""
    copies = 1 + 256 // len(planted.dictionary)
    generator = torch.Generator().manual_seed(0)
    copy = torch.randint(copies, (len(planted.index),), generator=generator)
    weights = SparseWeights(
        planted.offset,
        planted.index + len(planted.dictionary) * copy,
        planted.weight.detach() * 10.0 ** -(3.0 * torch.rand(len(copy), 1, generator=generator)),
    )
    lobes = LobeBatch.cat([planted.dictionary.detach()] * copies)
    model = with_parts(planted, lobes=lobes, weights=rounded(weights, weight_type))
    model.weight_type = weight_type
    return with_components(model, beside=beside)


@pytest.fixture(scope="module", params=RULES)
def relief(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file with a relief whose texture continues by either rule."""
    flat = planted_model(lobes_per_texel=4, residual=0.1)
    drift = 0.01 * torch.ones(len(flat.view), 2)
    model = with_relief(flat, planted_relief(flat.height, flat.width, 0.15, request.param, drift))
    path = tmp_path_factory.mktemp("relief") / "model.safetensors"
    path.write_bytes(model.pack())
    return path


@pytest.fixture(params=["planted", "fitted", "components", "components beside clusters"])
def file(request: pytest.FixtureRequest, planted: Path, run: Path, tmp_path: Path) -> Path:
    if request.param in ("planted", "fitted"):
        return planted if request.param == "planted" else run / "model.safetensors"
    beside = "beside" in request.param
    kind = torch.int16 if beside else torch.uint8
    path = tmp_path / "model.safetensors"
    path.write_bytes(version_2(SPMM.load(planted), kind, beside).pack())
    return path


def queries(model: SPMM) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Random texels `[Q]` and upper directions `[Q, 3]`, some below the lowest ring."""
    generator = torch.Generator().manual_seed(1)
    texel = torch.randint(model.texel_count, (QUERIES,), generator=generator)
    u = torch.rand(2, QUERIES, 2, generator=generator, dtype=torch.float64)
    theta, phi = torch.arccos(0.02 + 0.98 * u[..., 0]), 2.0 * math.pi * u[..., 1]
    wi, wo = direction_from_angles(theta, phi)
    return texel, wi, wo


def centres(model: SPMM, texel: torch.Tensor) -> torch.Tensor:
    """uv `[Q, 2]` of texels `[Q]`."""
    row, column = texel // model.width, texel % model.width
    return torch.stack(
        ((column + 0.5) / model.width, 1.0 - (row + 0.5) / model.height), dim=-1
    ).double()


@torch.no_grad()
def test_the_reader_agrees_with_the_package(reader: dict[str, Any], file: Path) -> None:
    model = SPMM.load(file)
    texel, wi, wo = queries(model)
    uv = centres(model, texel)
    expected = model(uv, wi, wo).numpy()
    tensors, metadata = reader["read"](file)
    found = reader["evaluate"](tensors, metadata, uv.numpy(), wi.numpy(), wo.numpy())
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()


@torch.no_grad()
def test_the_reader_walks_over_the_relief(reader: dict[str, Any], relief: Path) -> None:
    model = SPMM.load(relief)
    _, wi, wo = queries(model)
    uv = 3.0 * torch.rand(QUERIES, 2, generator=torch.Generator().manual_seed(2)).double() - 1.0
    tensors, metadata = reader["read"](relief)
    at = reader["hit"](tensors, metadata, uv.numpy(), wo.numpy())
    assert model.relief is not None
    expected = model.relief.field(model.height, model.width, model.view).hit(uv, wo).numpy()
    far = np.abs(at - expected).max(1) > 1e-4
    assert far.mean() < 0.01  # rays that graze a peak, which a march in steps may miss
    found = reader["evaluate"](tensors, metadata, uv.numpy(), wi.numpy(), wo.numpy())
    value = model(uv, wi, wo).numpy()
    assert np.abs(found - value)[~far].max() < 5e-3 * np.abs(value).max()


@torch.no_grad()
def test_the_reader_agrees_without_its_twins(reader: dict[str, Any], planted: Path) -> None:
    tensors, metadata = reader["read"](planted)
    model = SPMM.load(planted)
    _, wi, wo = queries(model)
    expected = model.dictionary.eval(wi[None], wo[None]).numpy()  # [J, Q]
    for name in ("lambertian", "ward"):
        for j in np.flatnonzero(model.lobe_model.numpy() == MODEL_NAMES.index(name)):
            found = reader["lobe"](tensors, metadata, j, wi.numpy(), wo.numpy())
            np.testing.assert_allclose(found, expected[j], rtol=1e-4, atol=1e-6)


@torch.no_grad()
def test_stored_values_come_back_at_measured_pairs(reader: dict[str, Any], planted: Path) -> None:
    tensors, _ = reader["read"](planted)
    light, view = tensors["directions.light"][7:8], tensors["directions.view"][31:32]
    found = reader["residual"](tensors, np.array([0]), light.astype(float), view.astype(float))
    stored = tensors["residual.code"][:1, 31, 7] * tensors["residual.scale"][:1, None]
    np.testing.assert_allclose(found, stored, atol=1e-6)


def test_the_reader_refuses_other_versions(
    reader: dict[str, Any], planted: Path, tmp_path: Path
) -> None:
    content = planted.read_bytes()
    assert content.count(b'"version":"2"') == 1
    content = content.replace(b'"version":"2"', b'"version":"3"')
    other = tmp_path / "other.safetensors"
    other.write_bytes(content)
    with pytest.raises(ValueError, match="version 1 or 2"):
        reader["read"](other)


def code_spans(cell: str) -> list[str]:
    """What stands in backticks."""
    return cell.split("`")[1::2]


def header(file: Path) -> dict[str, Any]:
    content = file.read_bytes()
    return json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])


def test_the_table_names_all_tensors(file: Path) -> None:
    listed = {name: row for row in table(PAGE, "tensor", "type", "shape", "content")
              for name in code_spans(row[0])}  # fmt: skip
    stored = header(file)
    metadata = stored.pop("__metadata__")
    stored = {name: entry for name, entry in stored.items() if not name.startswith("relief.")}
    assert set(stored) <= set(listed)
    model = SPMM.load(file)
    sizes = {
        "T": model.texel_count,
        "N": len(model.index),
        "C": model.weight.shape[1],
        "J": len(model.lobe_model),
        "P": model.kappa.shape[1],
        "K": len(model.residual.code),
        "R": model.components.rank if model.components else 0,
        "G": -(-len(model.lobe_model) // GROUP),
        "V": len(model.view),
        "L": len(model.light),
        "2": 2,
        "3": 3,
    }
    for name, entry in stored.items():
        _, kind, shape, _ = listed[name]
        assert entry["dtype"] in (INDEX if kind == "index" else kind.split(" or ")), name
        shapes = [[sizes[letter] for letter in each.split(", ")] for each in shape.split(" or ")]
        assert entry["shape"] in shapes, name
    keys = [key for row in table(PAGE, "key", "value") for key in code_spans(row[0])]
    assert sorted(keys) == sorted({*metadata, "horizon"} - {"rule"})


def test_every_tensor_of_the_table_is_in_some_file(planted: Path) -> None:
    listed = {
        name
        for row in table(PAGE, "tensor", "type", "shape", "content")
        for name in code_spans(row[0])
    }
    model = SPMM.load(planted)
    sharp = with_parts(model, lobes=replace(model.dictionary.detach(), horizon=0.0))
    models = (sharp, version_2(model, torch.uint8, beside=True))
    found = [each.to_tensors() for each in models]
    assert set().union(*(tensors for tensors, _ in found)) == listed
    assert found[1][0]["weights.count"].dim() == 2
    assert [metadata.get("version", "1") for _, metadata in found] == ["1", "2"]


def test_the_tables_name_all_of_a_relief(relief: Path) -> None:
    rows = table(PAGE, "tensor of the relief", "type", "shape", "content")
    listed = {code_spans(row[0])[0]: row for row in rows}
    stored = header(relief)
    metadata = stored.pop("__metadata__")
    assert {name for name in stored if name.startswith("relief.")} == set(listed)
    model = SPMM.load(relief)
    sizes = {"T": model.texel_count, "V": len(model.view), "1": 1, "2": 2}
    for name, (_, kind, shape, _) in listed.items():
        assert stored[name]["dtype"] == kind, name
        assert stored[name]["shape"] == [sizes[letter] for letter in shape.split(", ")], name
    keys = {key for row in table(PAGE, "key", "value") for key in code_spans(row[0])}
    own = {code_spans(row[0])[0] for row in table(PAGE, "key of the relief", "value")}
    assert set(metadata) == keys | own
    assert metadata["version"] == "2"


def test_the_file_is_plain_safetensors(planted: Path) -> None:
    with safetensors.safe_open(planted, framework="np") as file:
        assert file.metadata()["format"] == "spmm_torch"


def test_the_table_names_all_brdfs() -> None:
    listed = {
        code_spans(row[0])[0]: code_spans(row[1]) for row in table(PAGE, "model", "kappa", "f")
    }
    assert listed == {brdf.name: [row.name for row in brdf.parameters] for brdf in REGISTRY}


def test_the_table_names_all_files(run: Path) -> None:
    listed = {name for row in table(PAGE, "file", "content") for name in code_spans(row[0])}
    assert listed == {path.name for path in run.iterdir()}


def keys_of(report: Mapping[str, Any], listed: set[str]) -> Iterator[str]:
    """Keys as the table writes them: those below a key where it lists them."""
    for key, value in report.items():
        if isinstance(value, Mapping) and any(name.startswith(f"{key}.") for name in listed):
            yield from (f"{key}.{name}" for name in value)
        else:
            yield key


def test_the_table_names_all_keys_of_the_report(run: Path) -> None:
    rows = table(PAGE, "key", "unit", "meaning")
    listed = [key for row in rows for key in code_spans(row[0])]
    assert len(listed) == len(set(listed))
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    assert set(keys_of(report, set(listed))) == set(listed)
