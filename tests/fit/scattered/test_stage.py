"""Fits of scattered samples: planted lobes are found from random pairs, for other random pairs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch import SPMM, FitConfig, load_btf
from spmm_torch.data.error_weights import Weights
from spmm_torch.errors import ConfigError
from spmm_torch.evaluate.sample_errors import sample_errors
from spmm_torch.fit import FitResult, fit
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.scattered import search
from spmm_torch.metrics import snr_db
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Progress
from tests.planted.scattered import planted_values, random_pairs, save_samples

QUICK = {
    "search": {"models": ["lambertian", "ward"], "max_lobes": 3, "exchanges": 2},
    "dictionary": {"merge": 0.9999},
}


def quick(path: Path, **changes: Any) -> FitResult:
    return fit(load_btf(path), FitConfig.from_dict(QUICK | changes), render=False)


def held_out(model: SPMM, texel: int) -> float:
    """SNR in dB of a texel at random pairs that no fit saw."""
    wi, wo = random_pairs(3000, 99)
    row, column = divmod(texel, model.width)
    place = torch.tensor([(column + 0.5) / model.width, 1.0 - (row + 0.5) / model.height])
    wanted = planted_values(wi, wo, texel)
    with torch.no_grad():
        found = model(place.expand(len(wi), 2), wi, wo)
    energy, error = (float(part.square().sum()) for part in (wanted, found - wanted))
    return snr_db(energy, error)


def test_one_texel(tmp_path: Path) -> None:
    result = quick(save_samples(tmp_path / "a.npz", 1, 1500))
    assert held_out(result.model, 0) > 40.0
    report = result.report
    assert report["direction_pairs"] == 1500
    assert report["snr_db"]["cluster_mean"] is None
    assert report["bytes"]["residual"] == 0


def test_texels_with_pairs_of_their_own_share_lobes(tmp_path: Path) -> None:
    result = quick(save_samples(tmp_path / "a.npz", 4, 800))
    assert min(held_out(result.model, texel) for texel in range(4)) > 40.0
    assert len(result.model.dictionary) <= 6


def test_a_texel_of_few_samples_borrows_the_lobes_of_others(tmp_path: Path) -> None:
    """Twelve samples tell no lobe, but which of those found elsewhere."""
    path = save_samples(tmp_path / "a.npz", 2, 1500)
    with np.load(path) as file:
        arrays = {key: np.concatenate((file[key][:1500], file[key][-12:])) for key in file}
    np.savez(path, **arrays)
    assert held_out(quick(path, select={"min_gain": 1e-4}).model, 1) > 30.0


def test_texels_that_share_a_list(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 6, 800, shared=True, size=np.array([2, 3]))
    result = quick(path)
    assert min(held_out(result.model, texel) for texel in range(6)) > 40.0


def test_a_long_list_is_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "SOUGHT_PAIRS", 1200)
    assert held_out(quick(save_samples(tmp_path / "a.npz", 1, 20_000)).model, 0) > 40.0


def test_the_saved_model_has_the_errors_of_the_report(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 3, 300)
    result = quick(path, search=QUICK["search"] | {"max_lobes": 1})
    result.model.save(tmp_path / "m.safetensors")
    btf = load_btf(path)
    errors = sample_errors(SPMM.load(tmp_path / "m.safetensors"), btf)
    assert errors.totals().snr_db()["with_residual"] == pytest.approx(
        result.report["snr_db"]["with_residual"], abs=1e-4
    )
    assert result.report["bytes"]["total"] < 20_000


def test_the_log_says_once_that_there_is_no_grid(tmp_path: Path) -> None:
    lines: list[str] = []

    class Heard(Progress):
        def say(self, text: str) -> None:
            lines.append(text)

    path = save_samples(tmp_path / "a.npz", 2, 200)
    context = Context.build("cpu", 0, progress=Heard())
    fit(load_btf(path), FitConfig.from_dict(QUICK), context, render=False)
    assert [line for line in lines if "grid" in line] == [
        "scattered samples: 2 texels, 2 lists of 400 pairs of directions in all; without a grid "
        "there is neither a residual nor a relief"
    ]


def test_finished_stages_serve_again(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 2, 200)
    (tmp_path / "state").mkdir()
    models = []
    for _ in range(2):
        context = Context.build("cpu", 0, state=tmp_path / "state")
        result = fit(load_btf(path), FitConfig.from_dict(QUICK), context, render=False)
        models.append(result.model.pack())
        assert list((tmp_path / "state").glob("search*"))
    assert models[0] == models[1]


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"auto": True}, "auto of the settings needs a grid"),
        ({"relief": {"height": "a.png"}}, "relief.height of the settings needs a grid"),
        ({"weights": {"file": "a.npz"}}, "weights.scene and weights.file of the settings need"),
    ],
)
def test_settings_that_need_a_grid_are_refused(
    tmp_path: Path, settings: dict[str, Any], text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        quick(save_samples(tmp_path / "a.npz", 1, 20), **settings)


def test_weights_of_a_grid_are_refused(tmp_path: Path) -> None:
    """They were left out without a word."""
    btf = load_btf(save_samples(tmp_path / "a.npz", 2, 20))
    weights = Weights(texel=torch.tensor([1.5, 0.5]))
    with pytest.raises(ConfigError, match="weights of errors were given to a fit of scattered"):
        fit(btf, FitConfig.from_dict(QUICK), weights=weights, render=False)


@pytest.mark.parametrize("error", ["auto", "cube-root"])
def test_a_black_texel_beside_others(tmp_path: Path, error: str) -> None:
    """Its weights were infinite, and were refused as if they had been given."""
    path = save_samples(tmp_path / "a.npz", 2, 300)
    arrays = dict(np.load(path))
    arrays["rgb"][arrays["texel"] == 1] = 0.0
    np.savez(path, allow_pickle=False, **arrays)
    model = quick(path, weights={"error": error}).model
    assert held_out(model, 0) > 40.0
    wi, wo = random_pairs(100, 99)
    with torch.no_grad():
        assert not bool(model(torch.tensor([[0.75, 0.5]]).expand(100, 2), wi, wo).any())


def test_errors_of_values_and_of_cube_roots_count_unless_the_settings_say_otherwise() -> None:
    for asked, error in (("auto", "balanced"), ("log", "log"), ("l2", "l2")):
        config = FitConfig.from_dict({"weights": {"error": asked}})
        found = Objective.of_lists(config)
        assert (found.error, found.chosen) == (error, asked == "auto")
    paper = FitConfig.from_dict({"search": {"method": "stagewise"}})
    assert Objective.of_lists(paper).error == "l2"
