"""Lists of samples: kept where they lie, with what is between them missing."""

from __future__ import annotations

import builtins
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch import FitConfig
from spmm_torch.data import load_btf
from spmm_torch.data.scattered_btf import ScatteredBTF
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.fit import fit
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((0.0, 1), (30.0, 6), (60.0, 12))).double().numpy()  # [19, 3]
VIEW, LIGHT = DIRECTIONS[[0, 3, 9]], DIRECTIONS[[1, 5, 7, 12]]


def value(wi: np.ndarray, wo: np.ndarray, texel: np.ndarray) -> np.ndarray:
    """Something different for each sample, `[N, 3]`."""
    return np.stack((wi[:, 2], wo[:, 0] ** 2, 1.0 + texel), axis=1)


def make(pairs: list[tuple[int, int]], texels: int = 1, /, **changes: Any) -> dict[str, np.ndarray]:
    """The arrays of a list with the pairs (view, light) for each texel, in random order."""
    rows = [(view, light, texel) for texel in range(texels) for view, light in pairs]
    view, light, texel = np.random.default_rng(0).permutation(rows).T
    wi, wo = LIGHT[light], VIEW[view]
    arrays = {"wi": wi, "wo": wo, "rgb": value(wi, wo, texel), "texel": texel}
    return {key: array for key, array in (arrays | changes).items() if array is not None}


def save(path: Path, arrays: Mapping[str, np.ndarray]) -> Path:
    np.savez(path, allow_pickle=False, **arrays)
    return path


PAIRS = [(0, 0), (0, 2), (1, 1), (1, 3), (2, 0), (2, 1)]


def check(path: Path, texels: int) -> None:
    """The BTF of a list of PAIRS has its samples where they lie, and nothing else."""
    btf = load_btf(path)
    assert (len(btf.view), len(btf.light), btf.measured_count) == (3, 4, len(PAIRS))
    assert btf.names == tuple(f"texel {index}" for index in range(texels))
    wi, wo = (each.double().numpy() for each in btf.pairs())
    kept = btf.measured
    assert kept is not None
    for texel in range(texels):
        expected = torch.from_numpy(value(wi, wo, np.full(len(wi), texel))).float()
        torch.testing.assert_close(btf.texels()[texel, kept], expected[kept])


def test_samples_stay_where_they_lie(tmp_path: Path) -> None:
    check(save(tmp_path / "a.npz", make(PAIRS, 2)), 2)


def save_parquet(path: Path, arrays: Mapping[str, np.ndarray], **changes: object) -> Path:
    pyarrow = pytest.importorskip("pyarrow", reason="needs the extra parquet")
    from pyarrow import parquet

    columns: dict[str, object] = {
        f"{key}_{axis}": arrays[key][:, i] for key in ("wi", "wo") for i, axis in enumerate("xyz")
    }
    columns |= {name: arrays["rgb"][:, i] for i, name in enumerate("rgb")}
    columns |= {"texel": arrays["texel"]}
    parquet.write_table(pyarrow.table(columns | changes), path)
    return path


def test_parquet_is_the_same(tmp_path: Path) -> None:
    save_parquet(tmp_path / "a.parquet", make(PAIRS, 2))
    import pyarrow
    from pyarrow import parquet

    check(tmp_path / "a.parquet", 2)
    parquet.write_table(pyarrow.table({"wi_x": [1.0]}), tmp_path / "b.parquet")
    with pytest.raises(DataError, match="lacks the columns wi_y, wi_z, wo_x"):
        load_btf(tmp_path / "b.parquet")
    (tmp_path / "c.parquet").write_bytes((tmp_path / "a.parquet").read_bytes()[:50])
    with pytest.raises(DataError, match=r"c.parquet cannot be read .* copy it again"):
        load_btf(tmp_path / "c.parquet")


@pytest.mark.parametrize(
    ("name", "column"),
    [("wo_y", ["up"] * 6), ("g", [[0.1, 0.2]] * 6), ("b", [{"x": 0.1}] * 6), ("texel", ["0"] * 6)],
)
def test_parquet_columns_that_are_no_numbers_are_named(
    tmp_path: Path, name: str, column: list[object]
) -> None:
    path = save_parquet(tmp_path / "a.parquet", make(PAIRS), **{name: column})
    with pytest.raises(DataError, match=f"'{name}' of .*a.parquet .*; expected .*; save it so"):
        load_btf(path)


def test_parquet_without_its_package_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    plain = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return plain(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"pip install 'spmm_torch\[parquet\]'"):
        load_btf(tmp_path / "a.parquet")


def test_names_size_and_cosine(tmp_path: Path) -> None:
    named = make(PAIRS, 2, names=np.array(["wax", "tin"]))
    assert load_btf(save(tmp_path / "a.npz", named)).names == ("wax", "tin")
    texture = load_btf(save(tmp_path / "b.npz", make(PAIRS, 6, size=np.array([2, 3]))))
    assert (texture.names, texture.height, texture.width) == (None, 2, 3)
    plain, times = (load_btf(tmp_path / "b.npz", cosine=each) for each in ("auto", "missing"))
    torch.testing.assert_close(times.texels(), plain.texels() * plain.pairs()[0][:, 2:])


def test_repeated_samples_are_averaged_and_directions_that_nearly_meet_are_one(
    tmp_path: Path,
) -> None:
    arrays = make(PAIRS)
    again = arrays["wi"] + np.array([2e-4, 0.0, 0.0])
    twice = {
        "wi": np.concatenate((arrays["wi"], again)),
        "wo": np.tile(arrays["wo"], (2, 1)),
        "rgb": np.concatenate((arrays["rgb"], 3.0 * arrays["rgb"])),
    }
    btf, single = (
        load_btf(save(tmp_path / "a.npz", twice)),
        load_btf(save(tmp_path / "b.npz", arrays)),
    )
    assert (len(btf.view), len(btf.light)) == (3, 4)
    order = (btf.light @ single.light.T).argmax(1)
    expected = 2.0 * single.texels().view(3, 4, 3)[:, order].flatten(0, 1)[None]
    torch.testing.assert_close(btf.texels(), expected)


def test_texels_with_other_pairs_are_lists_or_masked(tmp_path: Path) -> None:
    arrays = make(PAIRS, 2)
    kept = ~((arrays["texel"] == 1) & (np.arange(12) < 6))
    path = save(tmp_path / "a.npz", {key: array[kept] for key, array in arrays.items()})
    shared = int((arrays["texel"][kept] == 1).sum())
    lists = load_btf(path)
    assert isinstance(lists, ScatteredBTF)
    assert [len(lists.samples(texel)[0]) for texel in (0, 1)] == [len(PAIRS), shared]
    assert load_btf(path, missing="mask").measured_count == shared


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rgb": np.ones((6, 4))}, r"'rgb' of .* has type float64 and shape \[6, 4\]"),
        ({"wi": np.ones((5, 3))}, "'wi' of .* N the same for wi, wo and rgb"),
        ({"wi": np.full((6, 3), np.nan)}, "'wi' of .* a direction that is not finite"),
        ({"rgb": np.full((6, 3), np.inf)}, "'rgb' of .* a value that is not finite"),
        ({"wo": np.tile([0.0, 0.0, -1.0], (6, 1))}, "'wo' of .* under the horizon"),
        ({"wo": np.tile([0.0, 0.0, 2.0], (6, 1))}, "'wo' of .* that is not unit"),
        ({"texel": np.zeros(6)}, r"'texel' of .* expected \[6\] whole numbers"),
        ({"texel": np.full(6, -1)}, r"'texel' of .* expected \[6\] whole numbers"),
        ({"texel": np.array([0, 0, 2, 2, 3, 3])}, "no sample of texel 1, of 4"),
        (
            {"texel": np.array([0, 0, 1, 1, 1, 1 << 50])},
            "no sample of texel 2, of 1125899906842625",
        ),
        ({"size": np.array([2, 2])}, "'size' of .* of 1 texels"),
        ({"names": np.array(["a", "b"])}, r"'names' of .* expected \[1\] texts"),
    ],
)
def test_malformed_lists_are_one_sentence(
    tmp_path: Path, changes: dict[str, np.ndarray], text: str
) -> None:
    with pytest.raises(DataError, match=text):
        load_btf(save(tmp_path / "a.npz", make(PAIRS, **changes)))


def test_a_list_in_a_zip_within_a_zip(tmp_path: Path) -> None:
    inner = save(tmp_path / "a.npz", make(PAIRS)).rename(tmp_path / "a.zip")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as outer:
        outer.write(inner, "a.zip")
    assert load_btf(tmp_path / "b.zip").texels().equal(load_btf(inner).texels())


def test_a_list_with_gaps_is_fit(tmp_path: Path) -> None:
    """Of a white surface, from a third of its pairs: what lies between them never counts."""
    rng = np.random.default_rng(1)
    view, light = np.divmod(rng.permutation(19 * 19)[:120], 19)
    wi = DIRECTIONS[light]
    arrays = {"wi": wi, "wo": DIRECTIONS[view], "rgb": np.repeat(wi[:, 2:], 3, axis=1) / np.pi}
    config = FitConfig.from_dict({"search": {"models": ["lambertian"]}, "residual": {"rank": 0}})
    result = fit(load_btf(save(tmp_path / "a.npz", arrays)), config)
    assert result.report["direction_pairs"] == 120
    assert result.report["snr_db"]["without_residual"] > 40.0
    up = torch.tensor([[0.0, 0.0, 1.0]])
    with torch.no_grad():
        seen = result.model(torch.tensor([[0.5, 0.5]]), up, up, residual=False)
    torch.testing.assert_close(seen, torch.full((1, 3), 1.0 / np.pi), rtol=0.02, atol=0.0)
