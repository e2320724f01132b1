"""Model files: what goes in comes out, and everything else is one clear sentence."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
import safetensors.torch
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.errors import OutputError
from spmm_torch.runtime import atomic, tensor_file
from spmm_torch.runtime.atomic import write_atomic

TENSORS = {
    "a.half": torch.arange(6, dtype=torch.float16).view(2, 3),
    "a.turned": torch.arange(6.0).view(2, 3).T,
    "b.empty": torch.zeros(0, 3),
    "b.scalar": torch.tensor(3, dtype=torch.int16),
}


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_round_trip(tmp_path: Path) -> None:
    content = tensor_file.pack(TENSORS, {"name": "wool · felt"})
    write_atomic(tmp_path / tensor_file.MODEL_FILE, content)
    for place in (tmp_path, str(tmp_path), tmp_path / tensor_file.MODEL_FILE):
        tensors, metadata = tensor_file.read(place, "cpu")
        assert metadata["name"] == "wool · felt"
        assert set(tensors) == set(TENSORS)
        for name, tensor in TENSORS.items():
            assert tensors[name].dtype == tensor.dtype
            assert torch.equal(tensors[name], tensor)
    assert [file.name for file in tmp_path.iterdir()] == [tensor_file.MODEL_FILE]


def test_two_names_of_one_tensor() -> None:
    one = torch.arange(3)
    assert tensor_file.pack({"a": one, "b": one}, {}) == tensor_file.pack(
        {"a": one, "b": one.clone()}, {}
    )


def test_same_tensors_same_bytes() -> None:
    turned = dict(reversed(TENSORS.items()))
    assert tensor_file.pack(TENSORS, {"x": "1", "y": "2"}) == tensor_file.pack(
        turned, {"y": "2", "x": "1"}
    )


def test_parameters_are_stored_as_values() -> None:
    parameter = torch.nn.Parameter(torch.ones(2))
    assert tensor_file.pack({"a": parameter}, {}) == tensor_file.pack({"a": torch.ones(2)}, {})


def bad_files() -> dict[str, tuple[bytes, str]]:
    good, tensors = tensor_file.pack(TENSORS, {}), {"a": torch.ones(3)}
    foreign = safetensors.torch.save(tensors)
    other = safetensors.torch.save(tensors, metadata={"format": "pt"})
    newer = safetensors.torch.save(
        tensors, metadata={"format": tensor_file.FORMAT, "version": "99"}
    )
    bare = safetensors.torch.save(tensors, metadata={"format": tensor_file.FORMAT})
    return {
        "cut short": (good[:-3], "is damaged or no model"),
        "cut in the header": (good[:20], "is damaged or no model"),
        "empty": (b"", "is an empty file, of 0 bytes"),
        "text": (b"hello" * 100, "is damaged or no model"),
        "pickle": (pickle.dumps({"format": "spmm_torch"}), "is damaged or no model"),
        "foreign": (foreign, "is no spmm_torch model"),
        "of torch": (other, "is no spmm_torch model"),
        "newer": (newer, "has version 99; this program reads versions 1 and 2"),
        "no version": (bare, "has version None"),
        "pointer": (b"version https://git-lfs.github.com/spec/v1\n", "is a pointer of Git LFS"),
    }


@pytest.mark.parametrize("case", bad_files())
def test_bad_files(tmp_path: Path, case: str) -> None:
    content, message = bad_files()[case]
    path = write(tmp_path / "x.safetensors", content)
    with pytest.raises(OutputError, match=message) as caught:
        tensor_file.read(path, "cpu")
    assert str(path) in str(caught.value)


def test_pickles_are_never_run(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple:
            return Path.touch, (tmp_path / "went off",)

    path = write(tmp_path / "x.safetensors", pickle.dumps(Bomb()))
    with pytest.raises(OutputError):
        tensor_file.read(path, "cpu")
    assert not (tmp_path / "went off").exists()


def test_nothing_there(tmp_path: Path) -> None:
    for place in (tmp_path / "no", tmp_path):
        with pytest.raises(OutputError, match="does not exist; expected a run folder"):
            tensor_file.read(place, "cpu")


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a", b"old")

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(atomic.os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, b"new")
    assert path.read_bytes() == b"old"


@given(st.lists(st.integers(0, 2**31 - 1), max_size=5), st.booleans())
def test_narrow_keeps_values(values: list[int], short: bool) -> None:
    index = torch.tensor([value % 256 if short else value for value in values], dtype=torch.long)
    assert torch.equal(tensor_file.narrow(index).long(), index)


@pytest.mark.parametrize(
    ("largest", "dtype"),
    [
        (0, torch.uint8),
        (255, torch.uint8),
        (256, torch.int16),
        (32767, torch.int16),
        (32768, torch.int32),
        (2**31 - 1, torch.int32),
    ],
)
def test_narrow_takes_the_smallest_type(largest: int, dtype: torch.dtype) -> None:
    assert tensor_file.narrow(torch.tensor([0, largest])).dtype == dtype
    assert tensor_file.narrow(torch.zeros(0, dtype=torch.long)).dtype == torch.uint8
