"""Works that code and documents name are in docs/references.bib, and the other way round.

Two ways to name one: `[WDR11 §3.2]`, by its key, and `[Heitz and d'Eon 2014]`, by author and year.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import yaml

from spmm_torch import __version__
from tests.docs.markdown import files, name_of
from tests.locations import DOCS, ROOT

BIBLIOGRAPHY = DOCS / "references.bib"
SUFFIXES = (".py", ".md", ".yaml", ".yml", ".cff")
# Letters of the authors and two digits of the year; `*` stands for further authors.
KEY = re.compile(r"[A-Z][A-Za-z]{1,5}\*?\d{2}")
YEAR = re.compile(r"\b(?:1[6-9]|20)\d{2}\b")
BRACKETS = re.compile(r"\[([^\[\]]{1,200})\]")
# How far an author may stand before the year where no brackets say that it is a citation.
NEAR = 120
# Fields that say where a work appeared.
PLACES = frozenset({"journal", "booktitle", "publisher", "institution"})


@dataclass(frozen=True)
class Work:
    """An entry of the bibliography.

    Attributes:
        key: of the entry.
        kind: article, book and so on.
        names: plain surnames of its authors.
        year: of its appearance.
        fields: all that it says, by name.
    """

    key: str
    kind: str
    names: frozenset[str]
    year: str
    fields: dict[str, str]


def plain(text: str) -> str:
    """Text without accents and TeX marks."""
    text = unicodedata.normalize("NFKD", re.sub(r'\\["\'`v]|[{}]', "", text))
    return "".join(letter for letter in text if not unicodedata.combining(letter))


def works() -> dict[str, Work]:
    """The bibliography by key."""
    text = BIBLIOGRAPHY.read_text(encoding="utf-8")
    found = {}
    for entry in re.split(r"^@", text, flags=re.MULTILINE)[1:]:
        kind, key = re.findall(r"^(\w+)\{(\w+),", entry)[0]
        fields = dict(re.findall(r"(\w+) = \{(.*?)\}(?:,|$)", entry, flags=re.MULTILINE))
        authors = [plain(author).split(",")[0] for author in fields["author"].split(" and ")]
        assert key not in found, f"{key} stands twice"
        found[key] = Work(key, kind, frozenset(authors), fields["year"], fields)
    return found


WORKS = works()


def texts() -> Iterator[tuple[str, str]]:
    """(name, text on one line, without accents) of all files that may name a work."""
    for path in files(*SUFFIXES):
        if path.name != "test_references.py":
            lines = path.read_text(encoding="utf-8").splitlines()
            yield name_of(path), plain(" ".join(re.sub(r"^\s*#?\s*", "", line) for line in lines))


TEXTS = dict(texts())


def keys_in(text: str) -> set[str]:
    """Keys in brackets, without their `*`."""
    words = [word for inside in BRACKETS.findall(text) for word in re.split(r"[\s,;]+", inside)]
    return {word.replace("*", "") for word in words if KEY.fullmatch(word)}


def unknown(inside: str) -> list[str]:
    """What brackets cite by author and year that the bibliography does not have."""
    missing, names = [], []
    start = 0
    for year in YEAR.finditer(inside):
        names = re.findall(r"[A-Z][A-Za-z'-]+", inside[start : year.start()]) or names
        matching = [work for work in WORKS.values() if work.year == year[0]]
        if names and not any(work.names & {plain_name(n) for n in names} for work in matching):
            missing.append(inside)
        start = year.end()
    return missing


def plain_name(name: str) -> str:
    """A surname as the bibliography has it, of one that lost its d or its umlaut."""
    return {"Eon": "d'Eon", "Mueller": "Muller", "Duer": "Dur"}.get(name, name)


def is_named(work: Work, text: str) -> bool:
    """Whether a text names a work, by its key or by an author close before its year."""
    if work.key in keys_in(text):
        return True
    near = (text[max(0, year.start() - NEAR) : year.start()] for year in YEAR.finditer(text)
            if year[0] == work.year)  # fmt: skip
    return any(name in part for part in near for name in work.names)


def test_every_key_is_in_the_bibliography() -> None:
    missing = {name: keys_in(text) - set(WORKS) for name, text in TEXTS.items()}
    assert {name: keys for name, keys in missing.items() if keys} == {}


def test_every_author_and_year_is_in_the_bibliography() -> None:
    missing = {
        name: [bad for inside in BRACKETS.findall(text) for bad in unknown(inside)]
        for name, text in TEXTS.items()
    }
    assert {name: bad for name, bad in missing.items() if bad} == {}


def test_every_work_is_named() -> None:
    unnamed = [
        key
        for key, work in WORKS.items()
        if not any(is_named(work, text) for text in TEXTS.values())
    ]
    assert unnamed == []


def test_no_work_has_two_keys() -> None:
    titles = Counter(plain(work.fields["title"]).casefold() for work in WORKS.values())
    assert [title for title, count in titles.items() if count > 1] == []


def test_every_work_says_where_it_appeared() -> None:
    for key, work in WORKS.items():
        assert {"author", "title", "year"} <= set(work.fields), key
        assert work.kind == "misc" or PLACES & set(work.fields), key


def test_the_search_sees_citations() -> None:
    assert keys_in("as in [WDR11 §3.2, ZY07] and [WBS*04]") == {"WDR11", "ZY07", "WBS04"}
    assert unknown("Golub and Pereyra 1973, Kaufman 1975") == []
    assert unknown("Burley 2012, 2015") == []
    assert unknown("Kaufman 1976") != []
    assert unknown("Nobody 1975") != []


def test_the_citation_file_says_what_the_package_says() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert str(citation["version"]) == __version__
    (paper,) = citation["references"]
    work = WORKS["WDR11"].fields
    assert paper["title"] == plain(work["title"])
    authors = [f"{person['family-names']}, {person['given-names']}" for person in paper["authors"]]
    assert authors == work["author"].split(" and ")
