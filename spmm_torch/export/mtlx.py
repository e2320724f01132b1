"""MaterialX documents, made node by node."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree import ElementTree

VERSION = "1.39"
# Space of colours that carry a curve; all else is linear sRGB.
LINEAR_SPACE, CURVED_SPACE = "lin_rec709", "srgb_texture"
WRAPS = {"repeat": "periodic", "mirror": "mirror"}
GRAPH = "textures"


@dataclass(frozen=True)
class Input:
    """An input of a node.

    Attributes:
        kind: type, such as `vector3`.
        more: attributes that say where it comes from.
    """

    kind: str
    more: dict[str, str]

    @classmethod
    def value(cls, kind: str, value: object) -> Input:
        """A constant."""
        return cls(kind, {"value": str(value)})

    @classmethod
    def node(cls, kind: str, name: str, **more: str) -> Input:
        """What a node gives."""
        return cls(kind, {"nodename": name, **more})

    @classmethod
    def graph(cls, kind: str, output: str) -> Input:
        """What the graph gives."""
        return cls(kind, {"nodegraph": GRAPH, "output": output})


@dataclass
class Document:
    """A document with a graph of textures.

    Attributes:
        wrap: how pictures continue beyond their border.
        outputs: type of each output of the graph.
    """

    wrap: str
    outputs: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.root = ElementTree.Element("materialx", version=VERSION, colorspace=LINEAR_SPACE)
        self.graph = ElementTree.SubElement(self.root, "nodegraph", name=GRAPH)
        self.add("uv", "texcoord", "vector2")

    def add(self, name: str, node: str, kind: str, **inputs: Input) -> str:
        """Adds a node to the graph; gives its name."""
        self._node(self.graph, name, node, kind, inputs)
        return name

    def add_top(self, name: str, node: str, kind: str, **inputs: Input) -> str:
        """Adds a node beside the graph; gives its name."""
        self._node(self.root, name, node, kind, inputs)
        return name

    def add_picture(self, name: str, file: str, kind: str, space: str = "") -> str:
        """Adds a node that reads a picture; gives its name."""
        place = Input("filename", {"value": file, **({"colorspace": space} if space else {})})
        wrap = Input.value("string", self.wrap)
        at = Input.node("vector2", "uv")
        return self.add(
            name, "image", kind, file=place, texcoord=at, uaddressmode=wrap, vaddressmode=wrap
        )

    def give(self, output: str, kind: str, node: str) -> None:
        """Makes what a node gives an output of the graph."""
        self.outputs[output] = kind
        attributes = {"name": output, "type": kind, "nodename": node}
        ElementTree.SubElement(self.graph, "output", attributes)

    def text(self) -> str:
        """The document as XML; outputs of the graph stand behind its nodes."""
        self.graph[:] = sorted(self.graph, key=lambda part: part.tag == "output")
        ElementTree.indent(self.root)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(self.root, "unicode") + "\n"

    @staticmethod
    def _node(
        parent: ElementTree.Element, name: str, node: str, kind: str, inputs: dict[str, Input]
    ) -> None:
        added = ElementTree.SubElement(parent, node, {"name": name, "type": kind})
        for key, each in inputs.items():
            ElementTree.SubElement(
                added, "input", {"name": key.rstrip("_"), "type": each.kind, **each.more}
            )
