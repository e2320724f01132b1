"""Sheets of labelled pictures."""

from __future__ import annotations

import numpy as np

from spmm_torch.figures.sheet import LABEL_HEIGHT, MARGIN, Panel, sheet


def plain(height: int, width: int, value: int) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


def test_panels_are_where_they_belong_and_labelled() -> None:
    rows = [
        [Panel(plain(40, 90, 10), "a"), Panel(plain(40, 90, 60), "b")],
        [Panel(plain(30, 90, 110), "c")],
    ]
    shown = sheet(rows)
    assert (shown[MARGIN : MARGIN + 40, MARGIN : MARGIN + 90] == 10).all()
    places = [np.argwhere((shown == value).all(-1)).min(0).tolist() for value in (10, 60, 110)]
    assert places[0][0] == places[1][0] < places[2][0]
    assert places[0][1] == places[2][1] < places[1][1]
    label = shown[MARGIN + 40 : MARGIN + 40 + LABEL_HEIGHT, MARGIN : MARGIN + 90]
    assert 0 < (label < 128).any(-1).sum() < 200  # a letter


def test_long_labels_are_whole() -> None:
    narrow, wide = (sheet([[Panel(plain(20, 20, 0), text)]]) for text in ("a", "a" * 60))
    assert wide.shape[1] > narrow.shape[1] + 200
