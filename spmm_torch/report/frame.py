"""What all pages share: the frame of the document, and a row of cards."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .markup import Markup, join, tag
from .style import STYLE

Card = tuple[str, str, str]  # name, value, note


def document(title: str, sections: Iterable[str], style: str = STYLE) -> Markup:
    """A whole page, which needs no other file and no script."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Markup(style)),
    )
    body = tag("body", *sections)
    return join((Markup("<!DOCTYPE html>\n"), tag("html", head, body, lang="en"), "\n"))


def card_row(cards: Sequence[Card]) -> Markup:
    """Cards side by side; the first one is the main one."""
    parts = []
    for position, card in enumerate(cards):
        rows = zip(("name", "value", "note"), card, strict=True)
        content = (tag("div", text, class_=kind) for kind, text in rows)
        parts.append(tag("div", *content, class_="card" if position else "card main"))
    return tag("div", *parts, class_="cards")
