"""RGL tensor files against Mitsuba's BSDF `measured` and its own writer of the container."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spmm_torch.data.brdf_tables import rgl
from spmm_torch.data.brdf_tables.slices import Slices
from spmm_torch.data.brdf_tables.tensor_file import read_tensors
from spmm_torch.errors import DataError
from tests.data.brdf_tables.made_files import rgl_tensors, tensor_bytes, upper_directions

PI = np.pi
AZIMUTHS = {
    "isotropic": np.zeros(1),
    "two azimuths": np.array([-PI, PI]),
    "all around": np.linspace(-PI, PI, 7),
    "half": np.linspace(-PI, 0.0, 5),
    "quarter": np.linspace(-PI, -PI / 2.0, 4),
}


@pytest.mark.parametrize("jacobian", [0, 1])
@pytest.mark.parametrize("azimuths", AZIMUTHS)
def test_values_are_those_of_mitsuba(tmp_path: Path, azimuths: str, jacobian: int) -> None:
    mitsuba = pytest.importorskip("mitsuba", reason="needs the extra mitsuba")
    mitsuba.set_variant("scalar_rgb")
    payload = tensor_bytes(rgl_tensors(AZIMUTHS[azimuths], jacobian=jacobian))
    (tmp_path / "made.bsdf").write_bytes(payload)
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(tmp_path / "made.bsdf")})
    wi, wo = upper_directions(100, 1), upper_directions(100, 2)
    expected = []
    for light, view in zip(wi, wo, strict=True):
        interaction = mitsuba.SurfaceInteraction3f()
        interaction.wi = mitsuba.Vector3f(*view)
        value = bsdf.eval(mitsuba.BSDFContext(), interaction, mitsuba.Vector3f(*light))
        expected.append(np.ravel(value))
    found = rgl.parse(payload, "made").eval(wi, wo)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_the_container_is_that_of_mitsuba(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    tensor_io = pytest.importorskip("mitsuba", reason="needs the extra mitsuba").tensor_io
    tensors = rgl_tensors(AZIMUTHS["half"])
    tensor_io.write(str(tmp_path / "a.bsdf"), **tensors)
    found = read_tensors((tmp_path / "a.bsdf").read_bytes(), "a")
    assert set(found) == set(tensors)
    for name, array in tensors.items():
        np.testing.assert_array_equal(found[name], array)


def test_inversion_is_the_share_of_the_mass() -> None:
    """Of a density that grows as x and not with y, below (x, y) lie x^2 and y."""
    values = np.tile(np.linspace(0.0, 1.0, 5), (4, 1))
    u = np.random.default_rng(0).random((50, 2))
    found = Slices(values).invert(u, ())
    np.testing.assert_allclose(found, np.stack((u[:, 0] ** 2, u[:, 1]), 1), atol=1e-12)


def test_slices_stay_as_they_are_beyond_the_last_parameter() -> None:
    values = np.stack((np.full((2, 2), 1.0), np.full((2, 2), 3.0)))
    slices = Slices(values, (np.array([10.0, 20.0]),))
    at = np.array([0.0, 10.0, 15.0, 20.0, 90.0])
    np.testing.assert_allclose(slices.eval(np.full((5, 2), 0.5), (at,)), [1, 1, 2, 3, 3])


def without(name: str) -> bytes:
    tensors = rgl_tensors(AZIMUTHS["half"])
    del tensors[name]
    return tensor_bytes(tensors)


def spectral() -> bytes:
    tensors = rgl_tensors(AZIMUTHS["half"])
    return tensor_bytes({"spectra": tensors.pop("rgb"), **tensors})


def crooked() -> bytes:
    tensors = rgl_tensors(AZIMUTHS["half"])
    return tensor_bytes(tensors | {"vndf": tensors["vndf"][:2].copy()})


WHOLE = tensor_bytes(rgl_tensors(AZIMUTHS["half"]))


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (b"hello", "does not start with 'tensor_file'"),
        (WHOLE[:40], "cannot be read"),
        (WHOLE[:-1], "ends after the end of the file"),
        (WHOLE.replace(b"tensor_file\0\1\0", b"tensor_file\0\2\0"), "has version 2.0"),
        (without("rgb"), "no such array for 'rgb'"),
        (without("sigma"), "no such array for 'sigma'"),
        (spectral(), "holds spectra; expected the RGB file"),
        (crooked(), "expected axes that agree"),
    ],
)
def test_damage_is_one_sentence(payload: bytes, text: str) -> None:
    with pytest.raises(DataError, match=text) as caught:
        rgl.parse(payload, "gold.bsdf")
    assert str(caught.value).startswith("gold.bsdf")
