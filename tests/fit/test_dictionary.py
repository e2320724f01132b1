"""Merging: which of two lobes that are alike stays, and who may choose it."""

from __future__ import annotations

import torch

from spmm_torch.config.fit import DictionaryConfig
from spmm_torch.fit.dictionary import FoundLobes, merge_lobes
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.grid import DirectionGrid
from tests.planted.lobes import Lobe, lobe_batch

RINGS = ring_directions(((0.0, 1), (30.0, 6), (60.0, 12)))
GRID = DirectionGrid.build(RINGS, RINGS, torch.device("cpu"))


def found() -> FoundLobes:
    """Exponents 10 and 10.01 are alike, 300 is apart; the second is from the better fit."""
    lobes = lobe_batch(*(Lobe("blinn_phong", (n,)) for n in (10.0, 10.01, 300.0)))
    return FoundLobes(
        lobes, torch.tensor([0, 1, 1]), torch.tensor([0.3, 0.1, 0.2]).double(), torch.zeros(3)
    )


def test_shared_keeps_the_lobe_of_the_better_fit_for_all() -> None:
    dictionary = merge_lobes(found(), 2, GRID, DictionaryConfig(scope="shared", merge=0.99))
    assert dictionary.lobes.kappa[:, 0].tolist() == [torch.tensor(10.01).item(), 300.0]
    assert [choice.tolist() for choice in dictionary.choices] == [[0, 1], [0, 1]]


def test_clusters_keep_their_own() -> None:
    dictionary = merge_lobes(found(), 2, GRID, DictionaryConfig(scope="cluster", merge=0.99))
    assert len(dictionary.lobes) == 3
    assert [len(choice) for choice in dictionary.choices] == [1, 2]
    assert float(dictionary.lobes.kappa[dictionary.choices[0][0], 0]) == 10.0


def test_atoms_have_unit_norm() -> None:
    dictionary = merge_lobes(found(), 2, GRID, DictionaryConfig())
    assert torch.allclose(dictionary.atoms.norm(dim=1), torch.ones(len(dictionary.atoms)))
    values = GRID.eval(dictionary.lobes)
    assert torch.allclose(dictionary.atoms * dictionary.norm[:, None], values, rtol=1e-5)


def test_cluster_without_lobes_has_no_choice() -> None:
    dictionary = merge_lobes(found(), 3, GRID, DictionaryConfig(scope="cluster"))
    assert len(dictionary.choices[2]) == 0


def test_a_checkpoint_keeps_the_horizon() -> None:
    again = FoundLobes.from_tensors(found().to_tensors())
    assert again.lobes.horizon == found().lobes.horizon > 0.0
    assert torch.equal(again.lobes.kappa, found().lobes.kappa)
