"""HTML that cannot be written unescaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

VOID = frozenset({"img", "meta", "br"})


class Markup(str):
    """Text that is HTML already; `tag` escapes any other."""

    __slots__ = ()


def tag(name: str, /, *content: str, **attributes: str | float) -> Markup:
    """One element.

    Args:
        name: of the element.
        content: inside of it; escaped unless it is `Markup`.
        attributes: `class_` stands for class and `text_anchor` for text-anchor.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
        for key, value in attributes.items()
    )
    if name in VOID:
        return Markup(f"<{name}{given}>")
    return Markup(f"<{name}{given}>{join(content)}</{name}>")


def join(parts: Iterable[str]) -> Markup:
    """All parts one after another; escaped unless they are `Markup`."""
    return Markup("".join(part if isinstance(part, Markup) else escape(part) for part in parts))


def picture(uri: str, alternative: str, *, pixelated: bool) -> Markup:
    """An image by its data URI."""
    return tag("img", src=uri, alt=alternative, class_="pixelated" if pixelated else "smooth")


def figure(content: str, *caption: str) -> Markup:
    """A figure with its caption."""
    return tag("figure", content, tag("figcaption", *caption))


def table(head: Iterable[str], *rows: Iterable[str]) -> Markup:
    """A table that scrolls sideways where it is too wide."""
    top = tag("tr", *(tag("th", cell, scope="col") for cell in head))
    body = [tag("tr", *(tag("td", cell) for cell in row)) for row in rows]
    inner = tag("table", tag("thead", top), tag("tbody", *body))
    return tag("div", inner, class_="scroll")


def definitions(rows: Iterable[tuple[str, str]]) -> Markup:
    """A list of terms and what they are."""
    return tag("dl", *(join((tag("dt", term), tag("dd", text))) for term, text in rows))
