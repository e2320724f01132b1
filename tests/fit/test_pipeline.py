"""The whole fit on small BTFs: planted models are found again, odd inputs end well."""

from __future__ import annotations

import io
import math

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, ConfigError, FitConfig
from spmm_torch.data import blocks
from spmm_torch.fit import FitResult, fit
from spmm_torch.fit.pipeline import with_lobe_limit
from spmm_torch.fit.select import alternate
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.report import check_report
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.device import resolve_device
from spmm_torch.runtime.progress import Progress
from tests.planted.btfs import random_btf, texel_btf
from tests.planted.lobes import Lobe, lobe_batch
from tests.planted.models import measured_values
from tests.planted.settings import FLAT

DIRECTIONS = ring_directions(((0.0, 1), (35.0, 6), (65.0, 12)))
PALETTES = (
    (Lobe("lambertian"), Lobe("ward", (0.35, 0.35), 15.0, 40.0)),
    (Lobe("blinn_phong", (12.0,), 20.0, 200.0),),
)
SIDE = 4
SMALL = {
    "cluster": {"count": 4},
    "sample": {"per_cluster": 2},
    "search": {"max_lobes": 2, "restarts": 1, "bank_normals": 16, "exchanges": 0, "final_steps": 4},
    "device": "cpu",
}


def planted_btf() -> tuple[BTF, list[int]]:
    """4 x 4 texels with the lobes of one of two palettes, and their number of lobes."""
    generator = torch.Generator().manual_seed(1)
    values, counts = [], []
    for texel in range(SIDE * SIDE):
        palette = PALETTES[texel // 2 % len(PALETTES)]
        weight = 0.1 + torch.rand(len(palette), 3, generator=generator)
        values.append(lobe_batch(*palette).eval_grid(DIRECTIONS, DIRECTIONS).T @ weight)
        counts.append(len(palette))
    return texel_btf(torch.stack(values), DIRECTIONS, height=SIDE), counts


def noisy(height: int, width: int, black: tuple[int, ...] = ()) -> BTF:
    """Rough texels that no model fits; `black` ones reflect nothing."""
    generator = torch.Generator().manual_seed(2)
    cosine = DIRECTIONS[:, 2].repeat(len(DIRECTIONS))[:, None]  # [D, 1]
    values = cosine * (0.5 + torch.rand(height * width, len(cosine), 3, generator=generator))
    values[list(black)] = 0.0
    return texel_btf(values, DIRECTIONS, height=height)


def small(**sections: dict[str, object]) -> FitConfig:
    merged = {
        key: dict(value) if isinstance(value, dict) else value for key, value in SMALL.items()
    }
    for name, section in sections.items():
        merged[name] = {**merged.get(name, {}), **section}
    return FitConfig.from_dict(merged)


def check_errors(btf: BTF, result: FitResult) -> None:
    """The report is complete, and its errors are those of the model over all values."""
    check_report(result.report)
    values = btf.texels().double()
    energy = float(values.square().sum())
    for name, residual in (("without_residual", False), ("with_residual", True)):
        error = float((measured_values(result.model, residual).double() - values).square().sum())
        reported = energy * 10.0 ** (-result.report["snr_db"][name] / 10.0)
        assert math.isclose(reported, error, rel_tol=2e-3, abs_tol=1e-5 * energy)


def test_planted_model_is_found() -> None:
    btf, truth = planted_btf()
    result = fit(btf, FitConfig.from_dict({"device": "cpu", "cluster": {"count": 4}}), render=False)
    assert result.report["snr_db"]["without_residual"] >= 40.0
    assert result.report["mean_basis_per_texel"] <= sum(truth) / len(truth) + 1.0
    assert 40.0 <= result.report["snr_db"]["with_residual"] < math.inf  # it is stored as float16
    check_errors(btf, result)


def test_the_report_counts_how_solvers_ended() -> None:
    btf = noisy(2, 3)
    quick = {"pairs": 64, "adam_steps": 2, "lbfgs_steps": 4}
    for method, used in (
        ("corrective", {"kmeans", "varpro", "foba", "nnls"}),
        ("stagewise", {"kmeans", "adam", "lbfgs", "stagewise_lasso", "nnls"}),
    ):
        config = small(
            search={"method": method, **quick},
            stagewise={"eta": 0.2, "lambda_min": 0.2, "max_steps": 20},
            select={"method": method},
        )
        solvers = fit(btf, config, render=False).report["solvers"]
        ended = {name for name, ends in solvers.items() if sum(ends.values())}
        assert ended == used
        assert all(ends["not_finite"] == 0 for ends in solvers.values())
        select = "foba" if method == "corrective" else "stagewise_lasso"
        assert sum(solvers[select].values()) >= btf.texel_count


def test_result() -> None:
    btf = noisy(3, 4)
    told = io.StringIO()
    result = fit(btf, small(), Context.build("cpu", progress=Progress(told)), render=False)
    check_errors(btf, result)
    report, model = result.report, result.model
    assert (report["texels"], report["direction_pairs"], report["clusters"]) == (12, 361, 4)
    assert report["snr_db"]["with_residual"] >= report["snr_db"]["cluster_mean"] - 0.01
    assert report["bytes"]["total"] == len(model.pack())
    assert (model.weight >= 0.0).all()
    assert (model.height, model.width) == (3, 4)
    assert torch.equal(model.labels, result.info["labels"])
    assert len(set(result.info["samples"].tolist())) == len(result.info["samples"])
    for stage in ("load", "cluster", "search", "select"):
        assert f"{stage}: done in" in told.getvalue()


def test_same_seed_same_bytes_and_the_callers_generator_is_left_alone() -> None:
    btf = noisy(3, 3)
    state = torch.get_rng_state()
    first, second = fit(btf, small(), render=False), fit(btf, small(), render=False)
    assert first.model.pack() == second.model.pack()
    assert torch.equal(torch.get_rng_state(), state)


def test_one_texel() -> None:
    btf = noisy(1, 1)
    told = io.StringIO()
    result = fit(btf, small(**FLAT), Context.build("cpu", progress=Progress(told)), render=False)
    check_errors(btf, result)
    assert "cluster.count lowered from 4 to 1, there are only 1 texels" in told.getvalue()
    assert result.report["snr_db"]["with_residual"] > 60.0  # its own mean, in float16


def test_constant_texture() -> None:
    btf = texel_btf(noisy(1, 1).texels().expand(9, -1, -1), DIRECTIONS, height=3)
    told = io.StringIO()
    result = fit(btf, small(**FLAT), Context.build("cpu", progress=Progress(told)), render=False)
    check_errors(btf, result)
    assert result.report["clusters"] == 1
    assert "there are too few distinct texels" in told.getvalue()
    assert result.report["snr_db"]["with_residual"] > 60.0


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_black_texels(method: str) -> None:
    black = (0, 3, 4, 7)
    btf = noisy(2, 4, black)
    search = {"method": method, "pairs": 32, "adam_steps": 1, "lbfgs_steps": 1}
    result = fit(btf, small(search=search, select={"method": method}), render=False)
    check_errors(btf, result)
    assert result.model.weight.isfinite().all()
    assert float(measured_values(result.model, False)[list(black)].abs().max()) < 0.05


@pytest.mark.parametrize("light", [DIRECTIONS[1:2], DIRECTIONS], ids=["one pair", "one view"])
def test_few_pairs(light: Tensor) -> None:
    btf = random_btf(light, 3, 3, view=DIRECTIONS[3:4])
    result = fit(btf, small(), render=False)
    check_errors(btf, result)
    assert result.report["direction_pairs"] == btf.pair_count


@pytest.mark.parametrize(("factor", "rounding"), [(2.0**13, 0.1), (1e4, 2.0)])
def test_high_dynamic_range(factor: float, rounding: float) -> None:
    """Scale changes decibels not at all: the search is relative to each signal."""
    dim = noisy(2, 3)
    bright = texel_btf(factor * dim.texels(), DIRECTIONS, height=2)
    a, b = fit(dim, small(), render=False).report, fit(bright, small(), render=False).report
    for name in ("without_residual", "cluster_mean"):
        assert b["snr_db"][name] == pytest.approx(a["snr_db"][name], abs=0.01)
    # Only the rounding of the residual is left, which depends on where values lie between two
    # powers of two.
    assert b["snr_db"]["with_residual"] == pytest.approx(a["snr_db"]["with_residual"], abs=rounding)
    assert b["psnr_peak"] > 1e3


@pytest.mark.parametrize("limit", [1, 2])
def test_lobe_limit(limit: int) -> None:
    result = fit(noisy(3, 3), small(select={"max_lobes": limit, "min_gain": 0.0}), render=False)
    assert int(result.model.lobe_count_per_texel().max()) <= limit


def test_lobe_limit_holds_for_samples_too() -> None:
    config = FitConfig.from_dict({"select": {"max_lobes": 2}})
    assert with_lobe_limit(config).search.max_lobes == 2
    for same in ({}, {"select": {"max_lobes": 64}}, {"search": {"method": "stagewise"}}):
        config = FitConfig.from_dict(same)
        assert with_lobe_limit(config) == config


def test_limit_as_in_the_contract() -> None:
    config = FitConfig.from_dict({**SMALL, "select": {"max_lobes": 4}})
    result = fit(noisy(2, 2), config, render=False)
    assert int(result.model.lobe_count_per_texel().max()) <= 4


def test_the_papers_method_ends() -> None:
    """`configs/paper.yaml` in small: stagewise search and selection, nothing refit jointly."""
    config = small(
        search={"method": "stagewise", "max_lobes": 4, "pairs": 64, "adam_steps": 2},
        stagewise={"eta": 0.2, "lambda_min": 0.2, "max_steps": 20},
        dictionary={"scope": "cluster", "merge": 0.999},
        select={"method": "stagewise"},
        residual={"rank": 0, "clusters": True, "joint": False, "precision": "float32"},
        storage={"weights": "float32"},
    )
    btf = noisy(2, 3)
    result = fit(btf, config, render=False)
    check_errors(btf, result)
    assert all(math.isfinite(value) for value in result.report["snr_db"].values())
    assert result.report["snr_db"]["with_residual"] >= result.report["snr_db"]["without_residual"]
    assert result.model.residual.code.dtype == torch.float32


def test_block_size_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    btf = noisy(3, 4)
    whole = fit(btf, small(**FLAT), render=False).report["snr_db"]
    monkeypatch.setattr(blocks, "CPU_BLOCK_VALUES", 2 * btf.pair_count * 3)
    monkeypatch.setattr(alternate, "CPU_TEXELS", 2)
    assert blocks.block_texels(btf, torch.device("cpu")) == 2
    in_blocks = fit(btf, small(**FLAT), render=False).report["snr_db"]
    assert in_blocks == pytest.approx(whole, abs=1e-3)


def test_lobes_of_a_pilot_serve_the_whole_cluster() -> None:
    """A quarter of the texels choose; the others do nearly as well with the lobes of those."""
    btf = noisy(10, 10)
    whole, piloted = (
        fit(btf, small(**FLAT, cluster={"count": 1}, select={"pilot": pilot}), render=False)
        for pilot in (None, 24)
    )
    assert piloted.report["total_basis"] <= whole.report["total_basis"]
    for name in ("without_residual", "with_residual"):
        found, best = (result.report["snr_db"][name] for result in (piloted, whole))
        assert best - 0.2 < found != best
    check_errors(btf, piloted)


def test_devices() -> None:
    assert resolve_device("cpu") == torch.device("cpu")
    assert resolve_device("auto").type in ("cpu", "cuda")
    for name in ("abacus", "meta", "cuda:99"):
        with pytest.raises(ConfigError, match=f"device is '{name}'"):
            resolve_device(name)


@pytest.mark.gpu
def test_same_on_cuda() -> None:
    btf = noisy(3, 4)
    results = [
        fit(btf, small().override([f"device={device}"]), render=False) for device in ("cpu", "cuda")
    ]
    result = results[1]
    assert not result.model.weight.is_cuda
    # Above 80 dB it shows that a GPU is asked less often whether a solver has converged.
    on_cpu, on_cuda = (
        {name: min(value, 80.0) for name, value in each.report["snr_db"].items()}
        for each in results
    )
    assert on_cuda == pytest.approx(on_cpu, abs=0.2)
    check_errors(btf, result)
