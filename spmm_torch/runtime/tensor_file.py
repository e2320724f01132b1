"""Files of named tensors: versioned safetensors, never pickle."""

from __future__ import annotations

import json
from pathlib import Path

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from ..errors import OutputError
from .atomic import is_text
from .foreign import absence, foreign_file

FORMAT = "spmm_torch"
# Versions that are read. A file has the first, which all programs know, unless it needs another.
VERSIONS = ("1", "2")
MODEL_FILE = "model.safetensors"
# A safetensors file begins with the length of its JSON header, in 8 bytes.
HEADER_START = 8
# Its header is padded to a multiple of 8 bytes.
ALIGNMENT = 8
# Integer types of indices, with their largest values.
INDEX_TYPES = ((torch.uint8, 255), (torch.int16, 32767), (torch.int32, 2**31 - 1))


def narrow(index: Tensor) -> Tensor:
    """Indices `[...]`, not negative, in the smallest of INDEX_TYPES that holds them all."""
    largest = int(index.max()) if index.numel() else 0
    return index.to(next(kind for kind, limit in INDEX_TYPES if largest <= limit))


def pack(tensors: dict[str, Tensor], metadata: dict[str, str]) -> bytes:
    """The bytes of a file of named tensors `[...]`, with metadata, format and version.

    A `version` in the metadata replaces the first one.
    """
    marked = {"format": FORMAT, "version": VERSIONS[0], **metadata}
    # Copies, as the library refuses two names of one tensor.
    plain = {
        name: tensor.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, tensor in tensors.items()
    }
    return _in_order(safetensors.torch.save(plain, metadata=marked))


def _in_order(content: bytes) -> bytes:
    """The same file with sorted metadata, which the library orders at random."""
    start = HEADER_START + int.from_bytes(content[:HEADER_START], "little")
    header = json.loads(content[HEADER_START:start])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return len(text).to_bytes(HEADER_START, "little") + text + content[start:]


def read(run: Path | str, device: torch.device | str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Named tensors `[...]` and metadata of a run folder or model file.

    Raises:
        OutputError: there is no file, or it is damaged or of another version.
    """
    path = Path(run)
    if absence(path) is None and path.is_dir():
        path = path / MODEL_FILE
    if (reason := absence(path)) is not None:
        raise OutputError(
            f"{path} {reason}; expected a run folder made by spmm fit; check the path."
        )
    try:
        tensors, metadata = _opened(path, device)
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        if kind := foreign_file(path):
            raise OutputError(
                f"{path} is {kind.what}; expected the model itself; {kind.remedy}."
            ) from error
        raise OutputError(
            f"{path} is damaged or no model ({error}); fit it again with spmm fit."
        ) from error
    if metadata.get("format") != FORMAT:
        raise OutputError(f"{path} is no {FORMAT} model; expected one made by spmm fit.")
    if metadata.get("version") not in VERSIONS:
        raise OutputError(
            f"{path} has version {metadata.get('version')}; this program reads versions "
            f"{' and '.join(VERSIONS)}; fit it again with spmm fit."
        )
    # The library's empty tensors lie in a memory that they do not fill, which torch.export cannot
    # save.
    owned = {name: part if part.numel() else part.clone() for name, part in tensors.items()}
    return owned, metadata


def _opened(path: Path, device: torch.device | str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Named tensors `[...]` and metadata of a file.

    Raises:
        SafetensorError, OSError, ValueError: the file is damaged, or cannot be read.
    """
    if is_text(str(path)):
        with safetensors.safe_open(path, framework="pt", device=str(device)) as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            return tensors, file.metadata() or {}
    content = path.read_bytes()  # the library opens no names but those in UTF-8
    tensors = safetensors.torch.load(content)
    start = HEADER_START + int.from_bytes(content[:HEADER_START], "little")
    metadata = json.loads(content[HEADER_START:start]).get("__metadata__", {})
    return {name: tensor.to(device) for name, tensor in tensors.items()}, metadata
