"""Work is counted exactly where it is known."""

from __future__ import annotations

import torch

from spmm_torch.benchmark.counting import CountingStopwatch, Work, WorkCounter
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import COORDINATES
from spmm_torch.lobes.grid import DirectionGrid
from spmm_torch.runtime.sparse import csr_matrix

FLOAT = 4


def test_a_product() -> None:
    left, right = torch.ones(10, 20), torch.ones(20, 30)
    with WorkCounter(work := Work()):
        left @ right
    assert work == Work(2 * 10 * 20 * 30, FLOAT * (10 * 20 + 20 * 30 + 10 * 30))


def test_other_operations_count_what_they_write() -> None:
    values = torch.ones(100)
    with WorkCounter(work := Work()):
        values + 1.0
        values.sum()
    assert work == Work(100 + 1, FLOAT * (200 + 101))


def test_views_are_free_and_broadcasts_take_no_room() -> None:
    values = torch.ones(6)
    with WorkCounter(work := Work()):
        wide = values.view(2, 3).transpose(0, 1)[None].expand(50, 3, 2)
    assert work == Work()
    with WorkCounter(work):
        wide.sum()
    assert work.bytes == FLOAT * (6 + 1)


def test_sparse_products_count_what_is_stored() -> None:
    rows = torch.tensor([0, 1, 3], dtype=torch.int32), torch.tensor([0, 1, 2], dtype=torch.int32)
    matrix = csr_matrix(*rows, torch.ones(3), (2, 3))
    dense = torch.ones(3, 5)
    with WorkCounter(work := Work()):
        matrix @ dense
    # Three numbers with their columns, three starts of rows, and both dense matrices.
    assert work == Work(2 * 3 * 5, FLOAT * (3 + 3 + 3 + 3 * 5 + 2 * 5))


def test_slopes_are_counted_too() -> None:
    directions = ring_directions(((0.0, 1), (45.0, 4)))
    grid = DirectionGrid.build(directions, directions, torch.device("cpu"))
    lobes = torch.tensor([[0, 3]]), torch.full((1, 2, COORDINATES), 0.4)
    with torch.no_grad():
        expected = grid.jacobian(*lobes)
        with WorkCounter(work := Work()):
            found = grid.jacobian(*lobes)
    assert work.flops > 2 * 25 * COORDINATES
    for one, other in zip(found, expected, strict=True):
        assert torch.equal(one, other)


def test_stages_are_counted_apart() -> None:
    watch = CountingStopwatch(torch.device("cpu"))
    with watch("total"):
        with watch("search"):
            torch.ones(3, 3) @ torch.ones(3, 3)
        with watch("select"):
            torch.zeros(7)
        torch.zeros(1000)
    assert set(watch.work) == {"search", "select"}
    assert watch.work["search"].flops == 2 * 27 + 2 * 9
    assert watch.work["select"] == Work(7, FLOAT * 7)
    assert set(watch.seconds) == {"search", "select", "total"}
