"""Files, folders and zips of tables as one BTF of named texels."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.data.brdf_tables import rgl
from spmm_torch.errors import ConfigError, DataError
from tests.data.brdf_tables.made_files import (
    grey,
    merl_bytes,
    rgl_tensors,
    tensor_bytes,
    write,
)

ISOTROPIC = np.zeros(1)


def grazing(theta_half: np.ndarray, theta_difference: np.ndarray, _phi: np.ndarray) -> np.ndarray:
    """1, but missing at theta_difference over 70 degrees."""
    values = np.where(theta_difference > np.radians(70.0), -1.0, 1.0)
    return np.repeat((values + 0.0 * theta_half)[..., None], 3, axis=-1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two MERL tables of 0.1 and 0.3, and one RGL table."""
    path = tmp_path_factory.mktemp("materials")
    write(path / "steel.binary", merl_bytes(grey(0.3)))
    write(path / "a" / "alum.binary", merl_bytes(grey(0.1)))
    write(path / "vinyl_rgb.bsdf", tensor_bytes(rgl_tensors(ISOTROPIC)))
    write(path / "README.txt", b"not a table")
    return path


def test_a_folder_is_a_batch_of_named_texels(folder: Path) -> None:
    btf = load_btf(folder)
    assert btf.names == ("alum", "steel", "vinyl_rgb")
    assert (btf.height, btf.width, btf.pair_count) == (1, 3, 81 * 81)
    wi, wo = btf.pairs()
    torch.testing.assert_close(btf.texels()[0, :, 1], 0.1 * wi[:, 2])
    torch.testing.assert_close(btf.texels()[1, :, 2], 0.3 * wi[:, 2])
    own = rgl.parse((folder / "vinyl_rgb.bsdf").read_bytes(), "vinyl")
    expected = torch.from_numpy(own.eval(wi.double().numpy(), wo.double().numpy())).float()
    torch.testing.assert_close(btf.texels()[2], expected)


def test_pictures_beside_tables_are_said_to_be_left_out(tmp_path: Path) -> None:
    write(tmp_path / "steel.binary", merl_bytes(grey(0.3)))
    write(tmp_path / "wool" / "tl000 pl000 tv000 pv000.png", b"")
    (note,) = load_btf(tmp_path).notes
    assert note.endswith("'wool/tl000 pl000 tv000 pv000.png'")
    assert load_btf(tmp_path / "steel.binary").notes == ()


def test_a_part_decodes_its_own_files_only(folder: Path) -> None:
    write(folder / "z" / "broken.binary", b"too short")
    try:
        part = load_btf(folder).restricted(torch.tensor([1, 0]), (1, 2), lights=torch.arange(5))
        assert part.names == ("steel", "alum")
        torch.testing.assert_close(
            part.picture(3, 4)[0, :, 0], torch.tensor([0.3, 0.1]) * part.light[4, 2]
        )
        with pytest.raises(DataError, match=r"'z/broken.binary' in .* expected 34,992,012 bytes"):
            load_btf(folder).load()
    finally:
        (folder / "z" / "broken.binary").unlink()


def test_one_file_and_more_directions(folder: Path) -> None:
    btf = load_btf(folder / "steel.binary", rings=151)
    assert (btf.name, btf.names, btf.texel_count) == ("steel", ("steel",), 1)
    assert len(btf.view) == len(btf.light) == 151
    torch.testing.assert_close(btf.texels()[0, :, 0], 0.3 * btf.pairs()[0][:, 2])
    with pytest.raises(ConfigError, match="rings is 80; expected one of 81, 151"):
        load_btf(folder / "steel.binary", rings=80)


def test_a_zip_is_read_as_its_folder(folder: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(folder / "a" / "alum.binary", "alum.binary")
        archive.write(folder / "vinyl_rgb.bsdf", "vinyl_rgb.bsdf")
    packed, loose = load_btf(tmp_path / "all.zip"), load_btf(folder)
    assert packed.names == ("alum", "vinyl_rgb")
    assert torch.equal(packed.texels(), loose.texels(torch.tensor([0, 2])))


def test_names_that_are_alike_keep_their_folder(tmp_path: Path) -> None:
    for place in ("x/gold.binary", "y/gold.binary", "y/tin.binary"):
        write(tmp_path / place, b"")
    assert load_btf(tmp_path).names == ("x/gold", "y/gold", "tin")


def test_a_format_is_known_by_its_first_bytes(folder: Path, tmp_path: Path) -> None:
    for name in ("steel.binary", "vinyl_rgb.bsdf"):
        write(tmp_path / "copy", (folder / name).read_bytes())
        assert load_btf(tmp_path / "copy").names == ("copy",)


def test_missing_values_are_refused_or_masked(folder: Path, tmp_path: Path) -> None:
    write(tmp_path / "gold.binary", merl_bytes(grazing))
    write(tmp_path / "steel.binary", (folder / "steel.binary").read_bytes())
    with pytest.raises(DataError, match=r"'gold.binary' in .* has no value at \d+ of 6561") as e:
        load_btf(tmp_path).load()
    assert "data.missing=mask" in str(e.value)
    btf = load_btf(tmp_path, missing="mask")
    wi, wo = btf.pairs()
    apart = torch.rad2deg(torch.arccos((wi * wo).sum(-1).clamp(-1.0, 1.0))) / 2.0
    clear = (apart - 70.0).abs() > 0.1
    assert btf.measured is not None
    assert torch.equal(btf.measured[clear], (apart < 70.0)[clear])
    assert bool((btf.texels()[:, ~btf.measured] == 0.0).all())
    torch.testing.assert_close(btf.texels()[1, btf.measured, 0], 0.3 * wi[btf.measured, 2])


def test_values_below_zero_name_the_file(tmp_path: Path) -> None:
    tensors = rgl_tensors(ISOTROPIC)
    tensors["rgb"] = tensors["rgb"] - np.float32(1.0)
    write(tmp_path / "teal_rgb.bsdf", tensor_bytes(tensors))
    with pytest.raises(DataError, match=r"teal_rgb.bsdf has values below zero .* as keep or clip"):
        load_btf(tmp_path / "teal_rgb.bsdf").load()
    assert float(load_btf(tmp_path / "teal_rgb.bsdf", negative="keep").texels().min()) < 0.0
    assert float(load_btf(tmp_path / "teal_rgb.bsdf", negative="clip").texels().min()) == 0.0
