"""Files of named tensors: versioned safetensors, never pickle."""

from __future__ import annotations

import json
from pathlib import Path

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from ..errors import OutputError

FORMAT, VERSION = "spmm_torch", 1
MODEL_FILE = "model.safetensors"
HEADER_START = 8  # a safetensors file begins with the length of its JSON header, in 8 bytes
# Largest value of each integer type that an array of indices may be narrowed to.
INDEX_TYPES = ((torch.uint8, 255), (torch.int16, 32767), (torch.int32, 2**31 - 1))


def narrow(index: Tensor) -> Tensor:
    """The same non-negative indices in the smallest type that holds them."""
    largest = int(index.max()) if index.numel() else 0
    return index.to(next(kind for kind, limit in INDEX_TYPES if largest <= limit))


def pack(tensors: dict[str, Tensor], metadata: dict[str, str]) -> bytes:
    """The content of a file of `tensors` with `metadata`, marked with format and version."""
    marked = {"format": FORMAT, "version": str(VERSION), **metadata}
    # Copies, as two names of one tensor are refused.
    plain = {
        name: tensor.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, tensor in tensors.items()
    }
    return _in_order(safetensors.torch.save(plain, metadata=marked))


def _in_order(content: bytes) -> bytes:
    """The same safetensors file with sorted metadata: the library shuffles it at every call."""
    start = HEADER_START + int.from_bytes(content[:HEADER_START], "little")
    header = json.loads(content[HEADER_START:start])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % HEADER_START)  # tensors stay aligned
    return len(text).to_bytes(HEADER_START, "little") + text + content[start:]


def read(run: Path | str, device: torch.device | str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors and metadata of a run folder or model file.

    Raises:
        OutputError: nothing there, damaged, or not of a version that this program reads.
    """
    path = Path(run)
    if path.is_dir():
        path = path / MODEL_FILE
    if not path.is_file():
        raise OutputError(
            f"{path} does not exist; expected a run folder made by spmm fit; check the path."
        )
    try:
        with safetensors.safe_open(path, framework="pt", device=str(device)) as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (safetensors.SafetensorError, OSError) as error:
        raise OutputError(
            f"{path} is damaged or no model ({error}); make it anew with spmm fit."
        ) from error
    if metadata.get("format") != FORMAT:
        raise OutputError(f"{path} is no {FORMAT} model; expected one made by spmm fit.")
    if metadata.get("version") != str(VERSION):
        raise OutputError(
            f"{path} has version {metadata.get('version')}; this program reads version {VERSION}; "
            f"make it anew with spmm fit."
        )
    return tensors, metadata
