"""Files as the library of the format's authors reads them: rows, transposes, colours, cosine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, load_btf, ubo2014
from spmm_torch.data.ubo2014 import FactorRows, Header, write_factors, write_ubo2014
from spmm_torch.data.ubo2014.colour import MODELS
from spmm_torch.data.ubo2014.header import VARIANTS
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.geometry.directions import direction_from_angles
from tests.data.ubo2014.independent_reader import load
from tests.data.ubo2014.planted import HEIGHT, LIGHT, VIEW, WIDTH, planted, random_btf
from tests.planted.btfs import texel_major

Make = Callable[..., Path]


def transposed(variant: str, **changes: object) -> dict[str, object]:
    """A planted file whose matrices have texels as rows."""
    parts = planted(variant) | changes
    left, right = parts["left"], parts["right"]
    if variant != "DFMF08FC":  # rows of (pair, channel) become rows of (texel, channel)
        random = np.random.default_rng(1)
        left = [random.integers(-3, 5, (WIDTH * HEIGHT * 3, left[0].shape[1]))]
        right = [random.integers(-3, 5, (len(VIEW) * len(LIGHT), right[0].shape[1]))]
        return parts | {"left": left, "right": right}
    return parts | {"left": right, "right": left}


@pytest.mark.parametrize("rows", ["top", "bottom"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_transposed_factors(make: Make, variant: str, rows: str) -> None:
    path = make(**transposed(variant))
    expected = np.maximum(load(path.read_bytes()).values(), 0.0)
    expected = expected if rows == "top" else expected[:, :, ::-1]
    btf = load_btf(path, rows=rows)
    assert torch.equal(btf.texels(), texel_major(expected))
    some = btf.restricted(torch.tensor([7, 2]), (1, 2), views=torch.tensor([1]))
    assert torch.equal(some.texels(), btf.texels(torch.tensor([7, 2]))[:, 3:])


def test_transposed_by_hand(make: Make) -> None:
    """Texel 0 under the last pair is the product of the first row of U and the last of SV."""
    parts = transposed("DFMF08FC")
    first, last = parts["left"][1][0], parts["right"][1][-1]
    found = ubo2014.read(make(**parts)).texels()[0, -1, 1]
    assert float(found) == max(first @ last, 0)


@pytest.mark.parametrize("model", [number for number in MODELS if number])
def test_colour_models(make: Make, model: int) -> None:
    random = np.random.default_rng(model)
    left = [random.uniform(0.2, 1.0, (6, 2)) for _ in range(3)]
    right = [random.uniform(0.2, 1.0, (20, 2)) for _ in range(3)]
    if model in (9, 10, 11, 12):  # dark enough that the offset shows, and both signs
        left[0] *= -4.0
        right[1] *= -1.0
    if model == 10:
        left[1:] = [8.0 * part for part in left[1:]]
    transform = random.uniform(-0.2, 1.0, (3, 3))
    path = make(
        left=left, right=right, colour_model=model, mean=(0.25, 0.5, 1.0), transform=transform
    )
    expected = texel_major(np.maximum(load(path.read_bytes()).values(), 0.0))
    assert ((expected > 0.0) & (expected != 1.0)).float().mean() > 0.3
    found = ubo2014.read(path).texels()
    scale = expected.abs().max()
    torch.testing.assert_close(found, expected.float(), rtol=1e-6, atol=1e-6 * float(scale))


def test_colour_model_11_by_hand(make: Make) -> None:
    """The ratios are to Y and its offset: of a texel of Y = 0, red is their V times the offset."""
    ones = np.ones((20, 1))
    left = [np.full((6, 1), value) for value in (np.log(1e-5), 0.0, 1.0)]
    found = ubo2014.read(make(left=left, right=[ones] * 3, colour_model=11)).texels()
    torch.testing.assert_close(found[..., 0], torch.full((20, 6), 1.13983e-5), rtol=0, atol=1e-9)


@pytest.mark.parametrize("model", [2, 5, 6, 7, 13])
def test_colour_models_that_nothing_defines_here(make: Make, model: int) -> None:
    with pytest.raises(DataError, match=f"has colour model {model} .*expected 0 .RGB., 1 .YUV."):
        ubo2014.read(make(colour_model=model))


def upright(width: int = WIDTH, height: int = HEIGHT) -> BTF:
    """Values that grow from texel to texel, in the directions of planted files."""
    texels = np.arange(1.0, width * height + 1.0).reshape(height, width)
    values = np.broadcast_to(texels[None, None, :, :, None], (2, 3, height, width, 3))
    view, light = (direction_from_angles(*torch.from_numpy(a).double().T) for a in (VIEW, LIGHT))
    return BTF.from_values(np.ascontiguousarray(values, np.float32), view.float(), light.float())


@pytest.mark.parametrize("rows", ["top", "bottom"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_written_rows(tmp_path: Path, variant: str, rows: str) -> None:
    """Whatever its order, our reader knows it; each foreign reader has one that stands upright."""
    btf, path = upright(), tmp_path / "a.btf"
    write_ubo2014(path, btf, variant=variant, rows=rows)
    for asked in ("top", "bottom"):
        found = load_btf(path, rows=asked)
        torch.testing.assert_close(found.texels(), btf.texels(), rtol=1e-5, atol=1e-5)
        assert found.notes == ()
    foreign = load(path.read_bytes())
    upside_down = {"top": foreign.pictures_of_btf_hh(), "bottom": foreign.values()}.pop(rows)
    upright_ones = {"top": foreign.values(), "bottom": foreign.pictures_of_btf_hh()}.pop(rows)
    np.testing.assert_allclose(upright_ones[:, :, ::-1], upside_down)
    cosine = btf.light[:, 2].numpy()[:, None, None, None]
    expected = np.stack([btf.pictures(view).numpy() for view in range(2)])
    np.testing.assert_allclose(upright_ones * cosine, expected, rtol=1e-5)


def test_rows_of_files_that_do_not_tell(make: Make) -> None:
    path = make()
    top, bottom = (load_btf(path, rows=rows) for rows in ("top", "bottom"))
    assert torch.equal(top.picture(0, 1), bottom.picture(0, 1).flip(0))
    assert not torch.equal(top.picture(0, 1), bottom.picture(0, 1))
    assert torch.equal(load_btf(path).texels(), top.texels())
    for btf, row in ((top, "top"), (bottom, "bottom")):
        assert f"which row of its pictures comes first: the {row} row is taken" in btf.notes[0]
    with pytest.raises(ConfigError, match="rows is 'left'; expected one of top, bottom"):
        load_btf(path, rows="left")
    codes = np.arange(6, dtype=np.uint16).reshape(2, 3)
    path = make("FMF12FCE", height_map=codes)
    np.testing.assert_array_equal(ubo2014.read_header(path, "bottom").height_map, codes[::-1])


def test_the_xml_of_a_measurement_is_kept(tmp_path: Path) -> None:
    factors = [FactorRows(np.ones(1), np.ones((6, 1)), np.ones((20, 1)))] * 3
    for rows in ("top", "bottom"):
        header = Header("DFMF08FC", WIDTH, HEIGHT, VIEW, LIGHT, xml="<a>ä</a>", rows=rows)
        write_factors(tmp_path / "a.btf", header, factors)
        found = ubo2014.read_header(tmp_path / "a.btf")
        assert (found.xml, found.rows) == ("<a>ä</a>", rows)


@pytest.mark.parametrize("xml", [b'<?spmm rows="left"?>', b'<?spmm rows="top"?><a/>', b"<a/>"])
def test_xml_that_states_no_order(make: Make, xml: bytes) -> None:
    header = ubo2014.read_header(make(xml=xml))
    assert (header.xml, header.rows) == (xml.decode(), None)


@pytest.mark.parametrize("settings", [{}, {"colour_model": 11}, {"variant": "FMF06FC"}])
def test_files_are_without_the_cosine(tmp_path: Path, settings: dict) -> None:
    """All readers see one reflectance: `btf.hh` stops at flag 1, the authors' library divides."""
    btf, path = random_btf(), tmp_path / "a.btf"
    write_ubo2014(path, btf, scalar=8, **settings)
    foreign = load(path.read_bytes())
    assert foreign.cosine == 0
    cosine = btf.light[:, 2].double().numpy()[:, None, None, None]
    expected = np.stack([btf.pictures(view).double().numpy() for view in range(len(btf.view))])
    np.testing.assert_allclose(foreign.reflectance() * cosine, expected, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(load_btf(path).texels(), btf.texels(), rtol=1e-5, atol=1e-6)


def test_a_light_at_the_horizon_keeps_the_cosine(tmp_path: Path) -> None:
    directions = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    values = np.random.default_rng(0).uniform(0.1, 1.0, (2, 2, 3, 4, 3)).astype(np.float32)
    btf = BTF.from_values(values, directions, directions)
    write_ubo2014(tmp_path / "a.btf", btf)
    assert ubo2014.read_header(tmp_path / "a.btf").cosine is True
    torch.testing.assert_close(load_btf(tmp_path / "a.btf").texels(), btf.texels())
