"""An independent reader and writer of `.btf` files, which shares nothing with the package.

`load` follows the library of the format's authors (github.com/cgbonn/btflib: `read_ubo_dfmf`,
`read_ubo_fmf`, `decode_dfmf_texture`, `decode_fmf_texture`, `undecorrelate`) in plain Python and
float64. `pictures_of_btf_hh` are those of BTF_extractor (github.com/2-propanol/BTF_extractor) and
the `btf.hh` that it wraps (github.com/zeroeffects/btf), which turn pictures upside down. `sections`
makes files field by field, so that tests can plant what our writer never would.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

MAGICS = {b"!DFMF08FC": "DFMF08FC", b"!FMF06FC": "FMF06FC", b"!FMF12FCE": "FMF12FCE"}
TYPES = {2: "<f2", 4: "<f4", 8: "<f8"}
EPSILON = 1e-5
YUV = np.array([[1.0, 0.0, 1.13983], [1.0, -0.39465, -0.5806], [1.0, 2.03211, 0.0]])
YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]])


@dataclass
class Loaded:
    """What a file holds; matrices as they are stored."""

    variant: str
    version: int = 0
    cosine: int | None = None
    xml: bytes = b""
    names: list[bytes] = field(default_factory=list)
    view: list[tuple[float, float]] = field(default_factory=list)
    light: list[tuple[float, float]] = field(default_factory=list)
    width: int = 0
    height: int = 0
    rotations: np.ndarray | None = None
    colour_model: int = 0
    mean: np.ndarray | None = None
    transform: np.ndarray | None = None
    reduced: int = 0
    height_map: np.ndarray | None = None
    singular_values: list[np.ndarray] = field(default_factory=list)
    left: list[np.ndarray] = field(default_factory=list)
    right: list[np.ndarray] = field(default_factory=list)

    def values(self) -> np.ndarray:
        """`[V, L, H, W, 3]` float64, row 0 at the top; nothing clamped, no cosine applied."""
        shape = (len(self.view), len(self.light), self.height, self.width)
        values = self.colours(np.stack(self.planes(), axis=-1))
        if self.reduced:
            values = np.exp(values) - EPSILON
        return values.reshape(*shape, 3)

    def planes(self) -> list[np.ndarray]:
        """The channels `[D, T]`, by the transposition that the rows of U tell."""
        pairs, texels = len(self.view) * len(self.light), self.width * self.height
        left = [part.astype(np.float64) for part in self.left]
        right = [part.astype(np.float64) for part in self.right]
        if self.variant == "DFMF08FC":
            by_pairs = len(left[0]) == pairs
            products = [u @ sv.T for u, sv in zip(left, right, strict=True)]
            return products if by_pairs else [product.T for product in products]
        product = left[0] @ right[0].T
        if len(left[0]) == 3 * pairs:  # channel fastest, then light, view
            return [product[channel::3] for channel in range(3)]
        assert len(left[0]) == 3 * texels  # channel fastest, then column, row
        return [product[channel::3].T for channel in range(3)]

    def colours(self, values: np.ndarray) -> np.ndarray:
        """RGB of decorrelated channels `[..., 3]`."""
        first, second, third = np.moveaxis(values, -1, 0)
        if self.colour_model == 1:
            return values @ YUV.T
        if self.colour_model == 3:
            return values @ self.transform.astype(float) + self.mean.astype(float)
        if self.colour_model == 4:
            return values @ YCOCG.T
        if self.colour_model == 12:
            return np.exp(values) - EPSILON
        if self.colour_model not in (9, 10, 11):
            return values
        y = np.exp(first) - EPSILON
        if self.colour_model == 10:
            second, third = (
                np.sign(part) * np.exp(np.abs(part) + np.log(EPSILON)) for part in (second, third)
            )
        if self.colour_model == 11:
            second, third = second * (y + EPSILON), third * (y + EPSILON)
        return np.stack((y, second, third), axis=-1) @ YUV.T

    def reflectance(self) -> np.ndarray:
        """`values` without the cosine of the light, as the authors' library gives them."""
        polar = np.array([angles[0] for angles in self.light])[:, None, None, None]
        return self.values() / np.cos(polar) if self.cosine else self.values()

    def pictures_of_btf_hh(self) -> np.ndarray:
        """`[V, L, H, W, 3]` as `btf.hh` gives them; it stops at a cosine flag."""
        assert not self.cosine
        return self.values()[:, :, ::-1]


class Reader:
    """Fixed-size fields, front to back."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.position = 0

    def take(self, count: int) -> bytes:
        payload = self.content[self.position : self.position + count]
        if len(payload) != count:
            raise ValueError("truncated")
        self.position += count
        return payload

    def number(self, kind: str) -> float:
        return struct.unpack(f"<{kind}", self.take(struct.calcsize(f"<{kind}")))[0]

    def matrix(self, kind: str, *shape: int) -> np.ndarray:
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        return np.frombuffer(self.take(size), kind).reshape(shape)


def load(content: bytes) -> Loaded:
    """Read a whole file.

    Raises:
        ValueError: it breaks a rule.
    """
    reader = Reader(content)
    magic = next((magic for magic in MAGICS if content.startswith(magic)), None)
    if magic is None:
        raise ValueError("magic")
    reader.take(len(magic))
    found = Loaded(MAGICS[magic])
    rotated = content[reader.position : reader.position + 1] == b"R"
    if rotated:
        reader.take(1)
    load_description(reader, found)
    load_sampling(reader, found)
    if rotated:
        found.rotations = reader.matrix("<f4", int(reader.number("I")), 3, 3)
    if found.variant == "DFMF08FC":
        load_channels(reader, found)
    else:
        load_shared(reader, found)
    if reader.position != len(content):
        raise ValueError("bytes after the end")
    return found


def load_description(reader: Reader, found: Loaded) -> None:
    start = reader.position
    size = reader.number("I")
    found.version = int(reader.number("I"))
    reader.take(3 * 80 + 4 + 3 * 4)
    if found.version > 1:
        found.cosine = int(reader.number("I"))
    if found.version > 2:
        found.xml = reader.take(int(reader.number("I")))
    found.names = [b"R", b"G", b"B"]
    if found.version > 3:
        found.names = [reader.take(int(reader.number("I"))) for _ in range(int(reader.number("I")))]
    if reader.position - start != size:
        raise ValueError("size")


def load_sampling(reader: Reader, found: Loaded) -> None:
    for view in range(int(reader.number("I"))):
        found.view.append((reader.number("f"), reader.number("f")))
        count = int(reader.number("I"))
        light = [(reader.number("f"), reader.number("f")) for _ in range(count)]
        if view > 0 and not np.allclose(light, found.light, rtol=0.0, atol=1e-3):
            raise ValueError("lights")
        found.light = light
    found.width, found.height = int(reader.number("I")), int(reader.number("I"))


def load_channels(reader: Reader, found: Loaded) -> None:
    reader.number("I")
    found.colour_model = int(reader.number("I"))
    found.mean, found.transform = reader.matrix("<f4", 3), reader.matrix("<f4", 3, 3)
    for _ in range(3):
        kind = TYPES[int(reader.number("B"))]
        load_factors(reader, found, kind, int(reader.number("I")))


def load_shared(reader: Reader, found: Loaded) -> None:
    if found.variant == "FMF12FCE":
        version = reader.number("B")
        if version >= 1:
            found.reduced = int(reader.number("I"))
        if version >= 2:
            width, height = int(reader.number("I")), int(reader.number("I"))
            if width * height:
                found.height_map = reader.matrix("<u2", height, width)
    first = int(reader.number("I"))
    kind = TYPES[int(reader.number("B"))]
    load_factors(reader, found, kind, min(first, int(reader.number("I"))))


def load_factors(reader: Reader, found: Loaded, kind: str, components: int) -> None:
    rows, columns = int(reader.number("I")), int(reader.number("I"))
    channels = 1 if found.variant == "DFMF08FC" else 3
    pairs, texels = len(found.view) * len(found.light), found.width * found.height
    if (rows, columns) not in ((pairs * channels, texels), (texels * channels, pairs)):
        raise ValueError("shape")
    found.singular_values.append(reader.matrix(kind, components))
    found.left.append(reader.matrix(kind, rows, components))
    found.right.append(reader.matrix(kind, columns, components))


def sections(
    variant: str,
    left: list[np.ndarray],
    right: list[np.ndarray],
    *,
    view: np.ndarray,
    light: np.ndarray,
    width: int,
    height: int,
    scalar: int = 4,
    version: int = 4,
    cosine: int = 1,
    xml: bytes = b"<btf/>",
    rotations: np.ndarray | None = None,
    colour_model: int = 0,
    mean: np.ndarray | None = None,
    transform: np.ndarray | None = None,
    extension: int = 2,
    reduced: int = 0,
    height_map: np.ndarray | None = None,
) -> dict[str, bytes]:
    """The fields of a file by name, in order; joined they are the file.

    Args:
        left, right: U and SV as they are to be stored, one each for each channel in DFMF.
        view, light: (polar, azimuth) `[N, 2]`.
        height_map: `[h, w]` in the order of the file.
        mean, transform: `[3]` and `[3, 3]` of colour model 3.
    """
    parts = {"magic": f"!{variant}".encode()}
    if rotations is not None:
        parts["letter"] = b"R"
    parts |= describe(version, cosine, xml)
    parts["view count"] = struct.pack("<I", len(view))
    for number, angles in enumerate(view.astype("<f4")):
        parts[f"view {number}"] = angles.tobytes()
        parts[f"light count {number}"] = struct.pack("<I", len(light))
        parts[f"lights {number}"] = light.astype("<f4").tobytes()
    parts["width"] = struct.pack("<I", width)
    parts["height"] = struct.pack("<I", height)
    if rotations is not None:
        parts["rotation count"] = struct.pack("<I", len(rotations))
        parts["rotations"] = rotations.astype("<f4").tobytes()
    if variant == "DFMF08FC":
        parts["components"] = struct.pack("<I", 12345)  # which loaders ignore
        parts["colour model"] = struct.pack("<I", colour_model)
        parts["mean"] = np.asarray(np.zeros(3) if mean is None else mean, "<f4").tobytes()
        parts["transform"] = np.asarray(
            np.eye(3) if transform is None else transform, "<f4"
        ).tobytes()
    if variant == "FMF12FCE":
        parts["extension"] = struct.pack("<B", extension)
        if extension >= 1:
            parts["reduced"] = struct.pack("<I", reduced)
        if extension >= 2:
            size = (0, 0) if height_map is None else height_map.shape
            parts["map width"] = struct.pack("<I", size[1])
            parts["map height"] = struct.pack("<I", size[0])
            if height_map is not None:
                parts["map"] = height_map.astype("<u2").tobytes()
    for channel, (u, sv) in enumerate(zip(left, right, strict=True)):
        parts |= factor_sections(variant, channel, u, sv, scalar)
    return parts


def describe(version: int, cosine: int, xml: bytes) -> dict[str, bytes]:
    """The header proper."""
    parts = {
        "size": b"",
        "version": struct.pack("<I", version),
        "setup": b"a dome".ljust(80, b"\0"),
        "sensor": b"a camera".ljust(80, b"\0"),
        "light source": b"a lamp".ljust(80, b"\0"),
        "resolution": struct.pack("<f", 7.5),
        "scale": struct.pack("<3f", 1.0, 2.0, 3.0),
    }
    if version > 1:
        parts["cosine"] = struct.pack("<I", cosine)
    if version > 2:
        parts["xml length"] = struct.pack("<I", len(xml))
        parts["xml"] = xml
    if version > 3:
        parts["channel count"] = struct.pack("<I", 3)
        for name in (b"R", b"G", b"B"):
            parts[f"name length {name.decode()}"] = struct.pack("<I", 1)
            parts[f"name {name.decode()}"] = name
    parts["size"] = struct.pack("<I", 4 + sum(map(len, parts.values())))
    return parts


def factor_sections(
    variant: str, channel: int, left: np.ndarray, right: np.ndarray, scalar: int
) -> dict[str, bytes]:
    """One factorization; its singular values are just numbers."""
    components = left.shape[1]
    kind = TYPES[scalar]
    parts = {}
    if variant != "DFMF08FC":
        parts[f"components 0 {channel}"] = struct.pack("<I", components)
    parts[f"scalar {channel}"] = struct.pack("<B", scalar)
    parts[f"components {channel}"] = struct.pack("<I", components)
    parts[f"rows {channel}"] = struct.pack("<I", len(left))
    parts[f"columns {channel}"] = struct.pack("<I", len(right))
    parts[f"singular values {channel}"] = np.arange(components, 0, -1).astype(kind).tobytes()
    parts[f"left {channel}"] = left.astype(kind).tobytes()
    parts[f"right {channel}"] = right.astype(kind).tobytes()
    return parts
