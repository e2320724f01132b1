"""What a search tells of its solvers, by either method."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from spmm_torch import FitConfig
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.data.error_weights import UNIFORM
from spmm_torch.fit.cluster import Samples
from spmm_torch.fit.dictionary import FoundLobes
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.load import load, posed
from spmm_torch.fit.problem import Problem
from spmm_torch.fit.search import joint
from spmm_torch.fit.search.joint import FEW_ROWS, CorrectiveSearch
from spmm_torch.fit.search.lobes import find_lobes, search_lobes, search_steps
from spmm_torch.fit.search.mixtures import Mixtures
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.grid import DirectionGrid
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Advance
from spmm_torch.solvers.foba import Selection
from tests.fit.glossy.test_peaks import lobe
from tests.hard.cases import Planted, planted_texture
from tests.planted.btfs import texel_btf
from tests.planted.lobes import Lobe

DIRECTIONS = ring_directions(((0.0, 1), (30.0, 6), (60.0, 10)))
WHITE = (1.0, 1.0, 1.0)
SAMPLES = 2
SETTINGS: dict[str, Any] = {
    "search": {
        "max_lobes": 2,
        "exchanges": 1,
        "restarts": 2,
        "pairs": 32,
        "adam_steps": 2,
        "lbfgs_steps": 4,
        "models": ["lambertian", "blinn_phong"],
    },
    "stagewise": {"max_steps": 3},
    "device": "cpu",
}


def problem_of(method: str, pairs: int = 32) -> tuple[Problem, Samples]:
    """Two planted texels; Eq. 5 is maximized on `pairs` direction pairs."""
    broad, sharp = Lobe("lambertian"), Lobe("blinn_phong", (60.0,), tilt=20.0)
    truths = [  # more lobes than the two that the search may use
        Planted((broad, sharp, Lobe("blinn_phong", (exponent,))), (WHITE, WHITE, WHITE))
        for exponent in (10.0, 20.0)
    ]
    btf = planted_texture(truths, DIRECTIONS, "planted")
    settings = {**SETTINGS, "search": {**SETTINGS["search"], "method": method, "pairs": pairs}}
    problem = Problem.build(btf, UNIFORM, FitConfig.from_dict(settings), Context.build("cpu"))
    samples = Samples(torch.arange(SAMPLES), torch.zeros(SAMPLES, dtype=torch.long))
    return problem, samples


@torch.no_grad()
def search(method: str, pairs: int = 32) -> FoundLobes:
    """The lobes of the texels of `problem_of`."""
    return search_lobes(*problem_of(method, pairs))


def names(found: FoundLobes) -> set[str]:
    """The models of the lobes."""
    return {MODEL_NAMES[model] for model in found.lobes.model.tolist()}


def totals(found: FoundLobes) -> dict[str, int]:
    """Problems of each solver that had any."""
    counts = found.solvers.to_dict()
    return {name: sum(row.values()) for name, row in counts.items() if sum(row.values())}


def test_corrective_search_counts_its_refinements_and_selections() -> None:
    found = search("corrective")
    count = totals(found)
    assert set(count) == {"varpro", "foba", "nnls"}
    assert count["varpro"] == int(found.starts[0]) > 0
    assert count["nnls"] == 3 * count["foba"]  # one of each channel
    assert int(found.solvers.to_dict()["nnls"]["converged"]) == count["nnls"]


def test_stagewise_search_counts_its_climbs_and_paths() -> None:
    found = search("stagewise")
    count = totals(found)
    assert set(count) == {"adam", "lbfgs", "stagewise_lasso"}
    assert count["adam"] == count["lbfgs"] == int(found.starts[0]) > 0
    # Three steps are too few for a path in steps of a few per cent.
    assert found.solvers.to_dict()["stagewise_lasso"]["limit"] == SAMPLES


def test_no_pair_is_searched_twice_where_more_are_asked_for_than_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A BTF of 16 pairs would else cost as much as one of the 512 pairs of the settings."""
    widths = []
    eval_at = DirectionGrid.eval_at

    def counted(grid: DirectionGrid, lobes: LobeBatch, pairs: torch.Tensor) -> torch.Tensor:
        widths.append(pairs.shape[1])
        return eval_at(grid, lobes, pairs)

    monkeypatch.setattr(DirectionGrid, "eval_at", counted)
    pair_count = len(DIRECTIONS) ** 2
    exact, more = (search("stagewise", pairs) for pairs in (pair_count, 20 * pair_count))
    assert set(widths) == {pair_count}
    assert torch.equal(exact.lobes.normal, more.lobes.normal)
    assert torch.equal(exact.lobes.kappa, more.lobes.kappa)


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_progress_goes_on_and_ends_at_the_number_of_steps(method: str) -> None:
    """Paths of the stagewise search were counted at their ends alone, when nearly all was done."""
    problem, samples = problem_of(method)
    steps: list[int] = []
    with torch.no_grad():
        find_lobes(problem, samples, problem.context.generator("search"), steps.append)
    assert sum(steps) == search_steps(problem.config, SAMPLES)
    assert min(steps) >= 0
    assert steps[0] + steps[1] > 0


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_counts_survive_a_checkpoint(method: str) -> None:
    found = search(method)
    again = FoundLobes.from_tensors(found.to_tensors())
    assert again.solvers.to_dict() == found.solvers.to_dict()
    assert torch.equal(again.starts, found.starts)


@torch.no_grad()
def test_ggx_joins_the_models_of_the_paper_where_each_texel_is_searched() -> None:
    """Felt and paint fade towards the horizon as GGX does, and as none of the seven models."""
    rough = Planted((Lobe("lambertian"), Lobe("ggx", (0.6, 0.6, 0.05))), (WHITE, WHITE))
    search_of_two = {"max_lobes": 2, "exchanges": 2, "bank_normals": 8}
    config = FitConfig.from_dict({**SETTINGS, "search": search_of_two})
    models = {}
    for count, chosen in ((1, True), (1, False), (FEW_ROWS + 1, True)):
        btf = planted_texture([rough] * count, DIRECTIONS, "rough")
        objective = Objective(chosen=chosen)
        problem = Problem.build(btf, UNIFORM, config, Context.build("cpu"), objective)
        samples = Samples(torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long))
        steps: list[int] = []
        found = find_lobes(problem, samples, torch.Generator(), steps.append)
        assert sum(steps) == search_steps(config, 1)
        models[count, chosen] = names(found)
        assert (float(found.error.max()) < 1e-7) == ("ggx" in models[count, chosen])
    assert models[1, True] == {"lambertian", "ggx"}
    assert "ggx" not in models[1, False] | models[FEW_ROWS + 1, True]


@torch.no_grad()
def test_sums_of_lobes_of_the_paper_keep_these() -> None:
    lobes = (Lobe("lambertian"), Lobe("ward", (0.3, 0.3)), Lobe("lafortune", (-1.0, 9.0)))
    btf = planted_texture([Planted(lobes, (WHITE,) * 3)], DIRECTIONS, "exact")
    config, objective = FitConfig(device="cpu"), Objective(chosen=True)
    problem = Problem.build(btf, UNIFORM, config, Context.build("cpu"), objective)
    samples = Samples(torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long))
    found = find_lobes(problem, samples, torch.Generator(), lambda steps: None)
    assert names(found) == {"lambertian", "ward", "lafortune"}
    assert float(found.error.max()) < 1e-7


@torch.no_grad()
def test_errors_of_cube_roots_are_relative_to_their_own_energy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Products of lobes and signals tell squared errors, whatever error a lobe is judged by."""
    grid = DirectionGrid.build(DIRECTIONS, DIRECTIONS, torch.device("cpu"))
    values = torch.stack([grid.eval(lobe(width, 0.9)).T + 0.001 for width in (0.01, 0.014)])
    settings = {"max_lobes": 2, "exchanges": 0, "restarts": 1, "bank_normals": 8}
    settings |= {"models": ["lambertian", "cook_torrance"], "refine_steps": 1, "final_steps": 1}
    config = FitConfig.from_dict({"search": settings, "device": "cpu"})
    btf = texel_btf(values.expand(-1, -1, 3), DIRECTIONS)
    problem = posed(load(btf, config, Context.build("cpu"), None), config)
    assert problem.objective.error == "cube-root"
    squared, relative = [], []
    select, run = joint.select_foba, CorrectiveSearch.run

    def selected(*products: torch.Tensor, **more: Any) -> Selection:
        squared.append(products[2])
        return select(*products, **more)

    def searched(finder: CorrectiveSearch, advance: Advance) -> Mixtures:
        found = run(finder, advance)
        relative.append(found.loss / finder.energy)
        return found

    monkeypatch.setattr(joint, "select_foba", selected)
    monkeypatch.setattr(CorrectiveSearch, "run", searched)
    texels = torch.arange(SAMPLES)
    found = find_lobes(problem, Samples(texels, texels), torch.Generator(), lambda steps: None)
    signals = problem.signals(texels)
    torch.testing.assert_close(squared[0], signals.double().square().sum((1, 2)), rtol=1e-5, atol=0)
    torch.testing.assert_close(found.error.unique(), relative[0].unique())
