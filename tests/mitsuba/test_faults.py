"""What the plug-ins refuse, in one sentence, and what they survive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch.errors import ConfigError
from spmm_torch.mitsuba import register
from spmm_torch.mitsuba.gradients import enable_gradients
from tests.mitsuba.queries import interaction, random_queries, vectors
from tests.planted.models import planted_model, with_relief
from tests.planted.runs import model_folder, newer_run


@pytest.mark.parametrize("plugin", ["spmm", "btf"])
def test_a_missing_file_is_named(plugin: str, scalar: Any, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"nothing_here does not exist; expected a"):
        scalar.load_dict({"type": plugin, "filename": str(tmp_path / "nothing_here")})
    with pytest.raises(RuntimeError, match=f"the bsdf {plugin} has no filename; expected a"):
        scalar.load_dict({"type": plugin})


def test_an_unknown_filter_is_refused(scalar: Any, tmp_path: Path) -> None:
    run = model_folder(tmp_path / "run", planted_model(size=2, lobes_per_texel=1))
    plugin = {"type": "spmm", "filename": str(run), "filter_type": "nearest"}
    with pytest.raises(RuntimeError, match=r"is 'nearest'; expected bilinear or stochastic;"):
        scalar.load_dict(plugin)


def test_a_transform_without_an_area_is_refused(scalar: Any, tmp_path: Path) -> None:
    run = model_folder(tmp_path / "run", planted_model(size=2, lobes_per_texel=1))
    flat = scalar.ScalarTransform4f().scale([0.0, 1.0, 1.0])
    with pytest.raises(RuntimeError, match=r"to_uv takes uv to .*expected a matrix that has an"):
        scalar.load_dict({"type": "spmm", "filename": str(run), "to_uv": flat})


def test_a_newer_format_is_refused(scalar: Any, tmp_path: Path) -> None:
    run = newer_run(tmp_path / "run")
    with pytest.raises(RuntimeError, match=r"has version 99; this program reads versions 1 and 2"):
        scalar.load_dict({"type": "spmm", "filename": str(run)})


def test_a_variant_without_gradients_is_told(scalar: Any, tmp_path: Path) -> None:
    run = model_folder(tmp_path / "run", planted_model(size=2, lobes_per_texel=1))
    parameters = scalar.traverse(scalar.load_dict({"type": "spmm", "filename": str(run)}))
    with pytest.raises(ConfigError, match="scalar_rgb has no gradients; expected"):
        enable_gradients(parameters)


def test_a_variant_of_spectra_is_refused(scalar: Any) -> None:
    scalar.set_variant("scalar_spectral")
    with pytest.raises(ConfigError, match="scalar_spectral; expected one whose light is RGB"):
        register()
    scalar.set_variant("scalar_rgb")


def test_gradients_of_named_parameters(mi: Any, tmp_path: Path) -> None:
    import drjit

    run = model_folder(tmp_path / "run", planted_model(size=2, lobes_per_texel=1))
    parameters = mi.traverse(mi.load_dict({"type": "spmm", "filename": str(run)}))
    assert enable_gradients(parameters, ("weight", "kappa")) == ["kappa", "weight"]
    assert drjit.grad_enabled(parameters["weight"])
    assert not drjit.grad_enabled(parameters["normal"])
    with pytest.raises(ConfigError, match=r"no parameter 'colour'; expected some of angle, kappa"):
        enable_gradients(parameters, ("colour",))


def test_broken_directions_are_black(mi: Any, tmp_path: Path) -> None:
    run = model_folder(tmp_path / "run", with_relief(planted_model(size=4)))
    bsdf = mi.load_dict({"type": "spmm", "filename": str(run)})
    uv, wi, wo = random_queries(8)
    uv[0], wi[1], wo[2], uv[3] = torch.nan, torch.nan, torch.nan, torch.inf
    uv[4] = 1e30
    value, density = bsdf.eval_pdf(mi.BSDFContext(), interaction(mi, uv, wo), vectors(mi, wi))
    assert np.isfinite(np.array(value)).all()
    assert np.isfinite(np.array(density)).all()
    assert (np.array(value)[:, :4] == 0.0).all()
    assert (np.array(value)[:, 5:] != 0.0).any()
