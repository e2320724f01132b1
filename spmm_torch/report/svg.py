"""Elements of inline SVG, always escaped."""

from __future__ import annotations

from markupsafe import Markup


def element(name: str, /, *content: str, **attributes: str | float) -> Markup:
    """One element.

    Args:
        name: of the element.
        content: of the element; escaped unless it is `Markup`.
        attributes: `class_` stands for class and `text_anchor` for text-anchor.
    """
    given = Markup().join(
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), value)
        for key, value in attributes.items()
    )
    return Markup("<{0}{1}>{2}</{0}>").format(name, given, Markup().join(content))
