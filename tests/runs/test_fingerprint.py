"""What a run depends on: the content of the input and of named files, and the settings."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch import BTF, FitConfig, load_btf
from spmm_torch.data import sample_path
from spmm_torch.data.error_weights import UNIFORM, Weights
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runs.fingerprint import difference, fingerprint, key_of
from tests.planted.pictures import encode_png, random_codes, write_pictures

DIRECTIONS = ring_directions(((0.0, 1), (45.0, 4)))
SHAPE = (5, 5, 2, 3, 3)


def facts_of(btf: BTF, *changes: str, weights: Weights = UNIFORM) -> dict[str, Any]:
    return fingerprint(btf, FitConfig().override(list(changes)), weights)


def values(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random(SHAPE).astype(np.float32)


def write_npz(path: Path, seed: int) -> None:
    np.savez(path, values=values(seed), view=DIRECTIONS, light=DIRECTIONS)


def write_set(path: Path, seed: int) -> None:
    """Pictures of the same size, whatever the seed."""
    codes = random_codes("uint8", (3, 3, 2, 2)) // 2
    codes[1, 2, 1, 0, 1] = seed
    write_pictures(path, codes, encode_png, ".png")


SOURCES: dict[str, Callable[[Path, int], None]] = {
    "a.npz": write_npz,
    "a.zip": write_set,
    "folder": write_set,
}


def keep_times(path: Path, seed: int, write: Callable[[Path, int], None]) -> None:
    """Writes a source anew, with the times that it had."""
    files = [path, *(path.rglob("*") if path.is_dir() else ())]
    times = {file: file.stat().st_mtime_ns for file in files}
    write(path, seed)
    for file, time in times.items():
        os.utime(file, ns=(time, time))


@pytest.mark.parametrize("name", SOURCES)
def test_other_values_of_the_same_size_are_another_input(tmp_path: Path, name: str) -> None:
    path, write = tmp_path / name, SOURCES[name]
    write(path, 1)
    before = facts_of(load_btf(path))
    assert facts_of(load_btf(path)) == before
    keep_times(path, 2, write)
    now = facts_of(load_btf(path))
    assert now["input"] != before["input"]
    assert difference(before, now).startswith("other content of the input")
    write(path, 1)
    assert facts_of(load_btf(path)) == before


@pytest.mark.parametrize("name", SOURCES)
def test_the_name_of_an_input_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = tmp_path / "in" / name
    path.parent.mkdir()
    SOURCES[name](path, 1)
    before = facts_of(load_btf(path))
    (tmp_path / "runs").mkdir()
    monkeypatch.chdir(tmp_path / "runs")
    assert facts_of(load_btf(f"../in/{name}")) == before
    shutil.move(path, tmp_path / f"other-{name}")
    assert facts_of(load_btf(tmp_path / f"other-{name}")) == before


def test_a_file_that_is_no_picture_of_the_folder_does_not_count(tmp_path: Path) -> None:
    write_set(tmp_path / "in", 1)
    before = facts_of(load_btf(tmp_path / "in"))
    (tmp_path / "in" / "notes.txt").write_text("a run may lie here")
    assert facts_of(load_btf(tmp_path / "in")) == before


def test_arrays_of_python() -> None:
    made = [BTF.from_values(values(seed), DIRECTIONS, DIRECTIONS) for seed in (1, 1, 2)]
    keys = [key_of(facts_of(btf)) for btf in made]
    assert keys[0] == keys[1] != keys[2]
    turned = BTF.from_values(values(1)[:, ::-1], DIRECTIONS, DIRECTIONS)
    assert key_of(facts_of(turned)) != keys[0]


def test_a_btf_that_no_file_tells_is_known_by_its_values() -> None:
    one, same, other = (BTF.from_values(values(s), DIRECTIONS, DIRECTIONS) for s in (1, 1, 2))
    for btf in (one, same, other):
        btf.content = None
    assert one.identity() == same.identity() != other.identity()


def test_a_format_without_checksums_of_its_own_is_read(tmp_path: Path) -> None:
    for path in (tmp_path / "a.npz", tmp_path / "b.npz"):
        write_npz(path, 1)
    plain = [replace(load_btf(path), content=None) for path in sorted(tmp_path.iterdir())]
    with zipfile.ZipFile(tmp_path / "b.npz", "a") as archive:
        archive.writestr("more", "1")
    assert plain[0].identity() != plain[1].identity()


def test_part_settings_and_weights_count() -> None:
    btf = load_btf(sample_path())
    facts = facts_of(btf)
    assert facts == json.loads(json.dumps(facts))
    assert facts["cluster.count"] == FitConfig().cluster.count
    part = btf.restricted(torch.arange(16), (4, 4))
    heavy = Weights(pair=torch.rand(btf.pair_count))
    others = (facts_of(part), facts_of(btf, "seed=1"), facts_of(btf, weights=heavy))
    assert len({key_of(each) for each in (facts, *others)}) == 4
    assert facts_of(load_btf(sample_path())) == facts


def test_named_files_count_by_their_content(tmp_path: Path) -> None:
    btf = load_btf(sample_path())
    for name, shade in (("a.png", 3), ("b.png", 3), ("c.png", 4)):
        Image.new("L", (40, 40), shade).save(tmp_path / name)
    one, same, other = (facts_of(btf, f"relief.height={tmp_path / n}.png") for n in "abc")
    assert one == same != other
    assert facts_of(btf, "weights.scene=a.yaml") == facts_of(btf, "weights.scene=/tmp/a.yaml")
