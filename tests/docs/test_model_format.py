"""docs/model_format.md: its reader agrees with SPMM, and its tables name what there is."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import direction_from_angles
from tests.brdf.numpy_twins import twin_of
from tests.docs.markdown import blocks, table
from tests.locations import DOCS
from tests.planted.models import planted_model

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


@pytest.fixture(params=["planted", "fitted"])
def file(request: pytest.FixtureRequest, planted: Path, run: Path) -> Path:
    return planted if request.param == "planted" else run / "model.safetensors"


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
    expected = model(centres(model, texel), wi, wo).numpy()
    tensors, metadata = reader["read"](file)
    found = reader["evaluate"](tensors, metadata, texel.numpy(), wi.numpy(), wo.numpy())
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()


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
    content = planted.read_bytes().replace(b'"version":"2"', b'"version":"3"')
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
    assert set(stored) == set(listed)
    model = SPMM.load(file)
    sizes = {
        "T": model.texel_count,
        "N": len(model.index),
        "C": model.weight.shape[1],
        "J": len(model.lobe_model),
        "P": model.kappa.shape[1],
        "K": model.cluster_count,
        "V": len(model.view),
        "L": len(model.light),
        "3": 3,
    }
    for name, entry in stored.items():
        _, kind, shape, _ = listed[name]
        assert entry["dtype"] in (INDEX if kind == "index" else kind.split(" or ")), name
        assert entry["shape"] == [sizes[letter] for letter in shape.split(", ")], name
    keys = [key for row in table(PAGE, "key", "value") for key in code_spans(row[0])]
    assert sorted(keys) == sorted({*metadata, "horizon"})


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
