"""Settings as frozen dataclasses: types, ranges and errors that name what would be right."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from spmm_torch.config.schema import (
    assign,
    describe,
    from_dict,
    parse_value,
    plain,
    setting,
)
from spmm_torch.config.written import read_yaml
from spmm_torch.errors import ConfigError


@dataclass(frozen=True)
class Inner:
    count: int = setting(3, "things", low=1, high=9)
    share: float = setting(0.5, "part of them", low=0.0, high=1.0)
    limit: int | None = setting(None, "most of them", low=1)


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    kinds: tuple[str, ...] = setting(("red",), "colours", choices=("red", "green", "blue"))
    method: str = setting("slow", "way", choices=("slow", "fast"))
    quiet: bool = setting(False, "whether")


def test_empty_mapping_gives_the_defaults() -> None:
    assert from_dict(Outer, {}) == Outer()


def test_values_of_every_type() -> None:
    values = {
        "inner": {"count": 9, "share": 1, "limit": 2},
        "kinds": ["green", "blue"],
        "method": "fast",
        "quiet": True,
    }
    read = from_dict(Outer, values)
    assert read == Outer(Inner(9, 1.0, 2), ("green", "blue"), "fast", True)
    assert type(read.inner.share) is float
    assert from_dict(Outer, {"kinds": "green"}).kinds == ("green",)
    assert from_dict(Outer, {"inner": {"limit": None}}).inner.limit is None


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "0.001"])
def test_numbers_without_a_point_are_numbers(text: str) -> None:
    """YAML 1.1 reads `1e-3` as text."""
    value = parse_value(text, f"share={text}", Inner)
    assert from_dict(Inner, {"share": value}).share == 0.001


BAD: dict[str, tuple[Any, str]] = {
    "unknown key": ({"metod": "fast"}, "unknown setting metod; did you mean method?"),
    "unknown inner key": ({"inner": {"cuont": 1}}, r"inner.cuont; did you mean inner.count\?"),
    "nothing near": ({"zzz": 1}, "unknown setting zzz; valid: inner, kinds, method, quiet."),
    "key that is no text": ({1: 1}, "unknown setting 1"),
    "section is a value": ({"inner": 3}, "inner is 3; expected a section with keys like count"),
    "text for int": ({"inner": {"count": "3"}}, "inner.count is '3'; expected a whole number"),
    "float for int": ({"inner": {"count": 3.0}}, "inner.count is 3.0; expected a whole number"),
    "bool for int": ({"inner": {"count": True}}, "inner.count is True; expected a whole number"),
    "bool for float": ({"inner": {"share": True}}, "inner.share is True; expected a number"),
    "text for float": ({"inner": {"share": "much"}}, "inner.share is 'much'; expected a number"),
    "null": ({"inner": {"count": None}}, "inner.count is None; expected a whole number"),
    "int for bool": ({"quiet": 1}, "quiet is 1; expected true or false"),
    "too low": ({"inner": {"count": 0}}, "inner.count is 0; expected 1 to 9"),
    "too high": ({"inner": {"share": 1.5}}, "inner.share is 1.5; expected 0.0 to 1.0"),
    "no upper end": ({"inner": {"limit": 0}}, "inner.limit is 0; expected at least 1"),
    "nan": ({"inner": {"share": float("nan")}}, "inner.share is nan; expected 0.0 to 1.0"),
    "infinite": ({"inner": {"share": float("inf")}}, "inner.share is inf"),
    "choice": ({"method": "fats"}, "method is 'fats'; expected one of slow, fast; did you mean"),
    "choice in list": ({"kinds": ["red", "gren"]}, "kinds is 'gren'; .*did you mean green?"),
    "list of numbers": ({"kinds": [3]}, "kinds is 3; expected a name"),
    "the same twice": ({"kinds": ["red", "green", "red"]}, "kinds names red twice; expected each"),
    "empty list": ({"kinds": []}, "kinds is empty; expected at least one value"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_values(case: str) -> None:
    values, message = BAD[case]
    with pytest.raises(ConfigError, match=message):
        from_dict(Outer, values)


def test_assign() -> None:
    values: dict[str, Any] = {"inner": {"count": 1}, "quiet": False}
    assign(values, ["inner", "share"], 0.25)
    assign(values, ["other", "key"], 1)
    assert values == {
        "inner": {"count": 1, "share": 0.25},
        "quiet": False,
        "other": {"key": 1},
    }
    with pytest.raises(ConfigError, match="quiet is a value, not a section"):
        assign(values, ["quiet", "more"], 1)


# Text of a setting, and what it is by the type of that setting; YAML 1.1 reads it otherwise.
BY_TYPE: dict[str, tuple[str, str, Any]] = {
    "leading zeros": ("inner.count", "007", 7),
    "not octal": ("inner.limit", "010", 10),
    "not base 60": ("note", "1:30", "1:30"),
    "digits of a name": ("note", "045", "045"),
    "a date": ("note", "2024-01-02", "2024-01-02"),
    "no boolean": ("note", "on", "on"),
    "boolean": ("quiet", "yes", True),
    "apostrophe": ("note", "my sister's scenes/s.yaml", "my sister's scenes/s.yaml"),
    "colon and hash": ("note", "a: b #c/s.yaml", "a: b #c/s.yaml"),
    "bracket": ("note", "[draft] s.yaml", "[draft] s.yaml"),
    "quotes": ("note", "'null'", "null"),
    "null": ("note", "null", None),
    "nothing": ("inner.limit", "", None),
    "numbers in a row": ("place", "010,010,020,020", (10, 10, 20, 20)),
    "a list of numbers": ("place", "[010, 08]", (10, 8)),
    "number of a list": ("sizes", "1e-3", (0.001,)),
}


@dataclass(frozen=True)
class Typed:
    inner: Inner = field(default_factory=Inner)
    note: str | None = setting("none", "a remark")
    quiet: bool = setting(False, "whether")
    place: tuple[int, ...] | None = setting(None, "where")
    sizes: tuple[float, ...] = setting((1.0,), "how large")


def value_at(settings: Any, key: str) -> Any:
    for name in key.split("."):
        settings = getattr(settings, name)
    return settings


@pytest.mark.parametrize("case", BY_TYPE)
def test_the_type_of_the_setting_reads_its_text(case: str) -> None:
    key, text, expected = BY_TYPE[case]
    values: dict[str, Any] = {}
    assign(values, key.split("."), parse_value(text, f"{key}={text}", Typed))
    found = value_at(from_dict(Typed, values), key)
    assert (found, type(found)) == (expected, type(expected))


@pytest.mark.parametrize(
    ("key", "text"),
    [("inner.count", "1:30"), ("inner.count", "0x9"), ("inner.share", "0b1"), ("place", "1_0,2")],
)
def test_numbers_of_yaml_that_nobody_means_are_refused(key: str, text: str) -> None:
    values: dict[str, Any] = {}
    assign(values, key.split("."), parse_value(text, f"{key}={text}", Typed))
    with pytest.raises(ConfigError, match=f"{key} is .*; expected a (whole )?number"):
        from_dict(Typed, values)


def test_files_are_read_by_type_too(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(
        "inner: {count: 007, share: 1e-1, limit: }\nnote: 1:30\nquiet: off\nplace: [010, 0020]\n"
    )
    expected = Typed(Inner(7, 0.1, None), "1:30", False, (10, 20))
    assert from_dict(Typed, read_yaml(path)) == expected


def test_a_key_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("inner:\n  count: 3\n  count: 4\n")
    with pytest.raises(ConfigError, match="the key count is there twice"):
        read_yaml(path)


def test_parse_value() -> None:
    assert parse_value("[red, 2]", "kinds=[red, 2]", Outer) == ["red", "2"]
    assert parse_value("null", "kinds=null", Outer) is None
    with pytest.raises(ConfigError, match=r"--set kinds=\[: the value is not valid YAML"):
        parse_value("[", "kinds=[", Outer)


def test_read_yaml(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("inner: {count: 2}\n", encoding="utf-8")
    assert read_yaml(path) == {"inner": {"count": "2"}}
    assert from_dict(Outer, read_yaml(path)).inner.count == 2
    path.write_text("# nothing\n", encoding="utf-8")
    assert read_yaml(path) == {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        (b"\xff\xfe\xff", "cannot be read"),
        (b"a: [1", "is not valid YAML"),
        (b"? {a: 1}\n: 2", "is not valid YAML"),
        (b"- 1\n- 2", "holds a list; expected sections"),
    ],
)
def test_bad_yaml(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "a.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read_yaml(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_plain_and_describe() -> None:
    assert plain({"a": (1, ("b",)), "c": {"d": ()}}) == {"a": [1, ["b"]], "c": {"d": []}}
    assert describe(Outer)[:2] == [
        ("inner.count", 3, "things", "1 to 9"),
        ("inner.share", 0.5, "part of them", "0.0 to 1.0"),
    ]
    assert [row.key for row in describe(Outer)] == [
        "inner.count",
        "inner.share",
        "inner.limit",
        "kinds",
        "method",
        "quiet",
    ]
