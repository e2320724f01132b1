"""Binary glTF files: JSON and one buffer of accessors and pictures."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
ALIGNMENT = 4
# Codes of the format, which are those of OpenGL.
FLOAT, UNSIGNED_SHORT = 5126, 5123
VERTICES, TRIANGLES = 34962, 34963
LINEAR, MIPMAPPED = 9729, 9987
WRAPS = {"repeat": 10497, "mirror": 33648}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


@dataclass
class Buffer:
    """What the binary chunk holds, and the JSON that points into it."""

    content: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)

    def add(self, payload: bytes, **more: Any) -> int:
        """Appends bytes; gives the number of their view."""
        self.content += b"\0" * (-len(self.content) % ALIGNMENT)
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(payload), **more}
        self.content += payload
        self.views.append(view)
        return len(self.views) - 1

    def add_array(self, array: np.ndarray, target: int) -> int:
        """Appends rows `[N]` or `[N, n]`; gives the number of their accessor."""
        kind = FLOAT if array.dtype == np.float32 else UNSIGNED_SHORT
        columns = array.shape[1] if array.ndim == 2 else 1
        rows = array.reshape(len(array), columns)
        self.accessors.append(
            {
                "bufferView": self.add(array.tobytes(), target=target),
                "componentType": kind,
                "count": len(array),
                "type": SHAPES[columns],
                "min": rows.min(0).tolist(),
                "max": rows.max(0).tolist(),
            }
        )
        return len(self.accessors) - 1

    def add_picture(self, name: str, png: bytes) -> int:
        """Appends a picture; gives the number of its texture, all of which share one sampler."""
        view = self.add(png)
        self.images.append({"name": name, "bufferView": view, "mimeType": "image/png"})
        return len(self.images) - 1

    def pack(self, document: dict[str, Any]) -> bytes:
        """The content of a .glb file, with the buffer's own parts added to the document."""
        whole = document | {
            "buffers": [{"byteLength": len(self.content)}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "images": self.images,
            "textures": [{"sampler": 0, "source": n} for n in range(len(self.images))],
        }
        text = json.dumps(whole, separators=(",", ":")).encode()
        chunks = _chunk(JSON_CHUNK, text, b" ") + _chunk(BINARY_CHUNK, bytes(self.content), b"\0")
        size = len(MAGIC) + 2 * ALIGNMENT + len(chunks)
        return MAGIC + _number(VERSION) + _number(size) + chunks


def _chunk(kind: bytes, content: bytes, filler: bytes) -> bytes:
    """A chunk of a padded length."""
    padded = content + filler * (-len(content) % ALIGNMENT)
    return _number(len(padded)) + kind + padded


def _number(value: int) -> bytes:
    return value.to_bytes(4, "little")
