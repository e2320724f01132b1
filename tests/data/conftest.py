"""Picture sets of every kind, and a make-believe format that counts what is decoded of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.data.cache import entry_key
from spmm_torch.data.codecs import openexr
from spmm_torch.data.codecs.radiance import RgbeExpansion
from spmm_torch.data.expansion import DepthExpansion, Expansion, FloatExpansion, TableExpansion
from spmm_torch.data.store import Loading
from spmm_torch.data.transpose import CodeStore, Place, ViewSource, open_store
from tests.planted.pictures import encode_atrium, encode_png, random_codes, write_pictures

EXPANSIONS = {
    "uint8": TableExpansion.gamma(2.2),
    "uint16": DepthExpansion(2.2),
    "rgbe": RgbeExpansion(),
    "float16": FloatExpansion(),
    "float32": FloatExpansion(),
}


WRITERS: dict[str, Callable[[Path], Path]] = {
    "png zip": lambda path: write_pictures(
        path / "a.zip", random_codes("uint8", (4, 3, 5, 6)), encode_png, ".png"
    ),
    "png folder": lambda path: write_pictures(
        path / "a", random_codes("uint8", (4, 3, 5, 6)), encode_png, ".png"
    ),
    "16-bit png zip": lambda path: write_pictures(
        path / "a.zip", random_codes("uint16", (4, 3, 5, 6)), encode_png, ".png"
    ),
    "atrium zip": lambda path: write_pictures(
        path / "a.zip", random_codes("rgbe", (4, 3, 5, 9)), encode_atrium, ".hdr"
    ),
    "exr half folder": lambda path: write_pictures(
        path / "a", random_codes("float16", (4, 3, 5, 6)), openexr.encode, ".exr"
    ),
    "exr float zip": lambda path: write_pictures(
        path / "a.zip", random_codes("float32", (4, 3, 5, 6)), openexr.encode, ".exr"
    ),
}


@pytest.fixture(params=WRITERS)
def picture_set(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A picture set of 4 views and 3 lights, of each kind."""
    return WRITERS[request.param](tmp_path)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder that is not made yet; the user's own one is out of reach."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    return tmp_path / "cache"


class Killed(BaseException):
    """Nothing catches it, as nothing catches a SIGKILL."""


@dataclass
class FakeFormat:
    """Codes `[V, L, T, B]` in memory, decoded view by view; `bands` lists what was asked for.

    Decoding is killed before it places view `dies_at`.
    """

    codes: np.ndarray
    expand: Expansion
    columns: int = 0
    dies_at: int | None = None
    bands: list[list[int]] = field(default_factory=list)

    def decode(self, views: Sequence[int], place: Place) -> None:
        self.bands.append(list(views))
        for view in reversed(views):  # any order is allowed
            if view == self.dies_at:
                raise Killed
            place(view, self.codes[view].copy())

    @property
    def source(self) -> ViewSource:
        return ViewSource(
            "the fake",
            self.codes.shape,
            self.codes.dtype,
            self.expand,
            self.decode,
            lambda: entry_key((self.codes.tobytes(),)),
            self.columns,
        )

    @property
    def texel_major(self) -> np.ndarray:
        """`[T, D, B]`."""
        views, lights, texels, width = self.codes.shape
        return self.codes.transpose(2, 0, 1, 3).reshape(texels, views * lights, width)

    def memory_of(self, views: int) -> int:
        """A limit under which bands have so many views."""
        return 2 * views * self.codes[0].nbytes

    def open(self, **loading: object) -> CodeStore:
        return open_store(self.source, Loading(**loading))


@pytest.fixture
def new_format() -> Callable[..., FakeFormat]:
    """A format of a kind, with 5 views under 3 lights of 7 texels."""

    def make(kind: str = "uint8", seed: int = 0, **options: object) -> FakeFormat:
        return FakeFormat(random_codes(kind, (5, 3, 7), seed), EXPANSIONS[kind], **options)

    return make


@pytest.fixture
def killed() -> type[BaseException]:
    return Killed


@pytest.fixture(params=EXPANSIONS)
def kind(request: pytest.FixtureRequest) -> str:
    return request.param
