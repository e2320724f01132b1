"""The planes of a model in OpenEXR: read by another library, they are the whole model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.export import TARGETS, NoSettings
from spmm_torch.export.exr import model_of_planes, planes_of
from spmm_torch.export.loss import random_queries
from spmm_torch.export.written import export
from spmm_torch.runtime.progress import Progress
from tests.planted.models import planted_model, uneven_model, with_components, with_relief

QUIET = Progress(enabled=False)
WHOLE = with_relief(with_components(planted_model(size=4, residual=0.02), beside=True))


def written(model: SPMM, path: Path) -> Path:
    export(model, TARGETS["exr"], path, NoSettings(), QUIET)
    return path


def by_openexr(path: Path) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, object]]:
    """Planes by OpenEXR's own module."""
    parts = OpenEXR.File(str(path), separate_channels=True).parts
    planes = {
        part.name(): {name: channel.pixels for name, channel in part.channels.items()}
        for part in parts
    }
    return planes, dict(parts[0].header)


def by_openimageio(path: Path) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, object]]:
    """Planes by OpenImageIO."""
    oiio = pytest.importorskip("OpenImageIO", reason="needs openimageio")
    source = oiio.ImageInput.open(str(path))
    planes, header, index = {}, {}, 0
    while source.seek_subimage(index, 0):
        spec = source.spec()
        pixels = source.read_image(index, 0, 0, spec.nchannels, "float")
        columns = np.moveaxis(pixels, -1, 0)
        planes[spec.getattribute("name")] = dict(zip(spec.channelnames, columns, strict=True))
        header |= {each.name: each.value for each in spec.extra_attribs}
        index += 1
    return planes, header


READERS = [by_openexr, by_openimageio]


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "model",
    [WHOLE, planted_model(size=2), uneven_model([1, 0, 4], 1, WHOLE.light, WHOLE.view)],
    ids=["whole", "lobes", "uneven"],
)
def test_foreign_planes_are_the_model(model: SPMM, read, tmp_path: Path) -> None:  # noqa: ANN001
    planes, header = read(written(model, tmp_path / "x.exr"))
    attributes = {
        name.removeprefix("spmm_torch:"): str(value)
        for name, value in header.items()
        if name.startswith("spmm_torch:")
    }
    assert attributes["format"] == "spmm_torch planes"
    for name, channels in planes_of(model).items():
        assert {each: plane.dtype for each, plane in planes[name].items()} == dict.fromkeys(
            channels, np.dtype(np.float32)
        )
        for channel, plane in channels.items():
            np.testing.assert_array_equal(planes[name][channel], plane)
    again = model_of_planes(planes, attributes)
    queries = [part[:500] for part in random_queries(500)]
    torch.testing.assert_close(again(*queries), model(*queries), rtol=1e-5, atol=1e-6)
