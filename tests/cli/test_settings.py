"""Options that are made of settings."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass

import pytest

from spmm_torch.cli.parser import Parser
from spmm_torch.cli.settings import (
    MIN_WIDTH,
    add_settings,
    in_yaml,
    of_switch,
    read_settings,
    settings_lines,
)
from spmm_torch.config.schema import REQUIRED, setting
from spmm_torch.errors import ConfigError


@dataclass(frozen=True)
class Settings:
    count: int = setting(3, "number of things", low=1, high=9)
    eye_rays: float = setting(0.5, "rays, 50 % of them")
    shape: str = setting("sphere", "shape", choices=("sphere", "plane"))
    quiet: bool = setting(False, "silence")
    names: tuple[str, ...] = setting(("a", "b"), "names")


@dataclass(frozen=True)
class Needed:
    name: str = setting(REQUIRED, "name of a thing")


def options(*words: str) -> Namespace:
    parser = Parser(prog="test")
    add_settings(parser, Settings, "count", "eye_rays", "shape", "quiet")
    return parser.parse_args(words)


def test_nothing_given_is_the_default() -> None:
    assert read_settings(Settings, options()) == Settings()


def test_values_have_their_types() -> None:
    words = ["--count", "7", "--eye-rays", "2", "--shape", "plane", "--quiet"]
    assert read_settings(Settings, options(*words)) == Settings(7, 2.0, "plane", True)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--count", "0"], "^--count is 0; expected 1 to 9.$"),
        (["--eye-rays", "nan"], "^--eye-rays is nan; expected a finite number.$"),
        (["--shape", "cube"], "argument --shape: invalid choice: 'cube'"),
        (["--names", "c"], "unrecognized arguments: --names c; test --help tells"),
    ],
)
def test_bad_values(words: list[str], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        read_settings(Settings, options(*words))


def test_lines_of_any_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "1")
    assert all(len(line) <= MIN_WIDTH for line in settings_lines(Settings))


def test_a_switch_is_no_question() -> None:
    assert of_switch("whether to leave out models") == "leave out models"
    assert of_switch("whether pictures are PNG") == "pictures are PNG"


def test_help_tells_meaning_range_and_default() -> None:
    parser = Parser(prog="test")
    add_settings(parser, Settings, "count", "eye_rays")
    text = " ".join(parser.format_help().split())
    assert "--count N number of things; 1 to 9 (default: 3)" in text
    assert "--eye-rays X rays, 50 % of them (default: 0.5)" in text


def test_settings_in_a_help_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "42")
    lines = settings_lines(Settings)
    assert lines[:2] == ["  count = 3   (1 to 9)", "      number of things"]
    assert "  names = [a, b]" in lines
    assert max(map(len, lines)) <= 40
    assert settings_lines(Needed) == ["  name, required", "      name of a thing"]


def test_defaults_as_in_a_settings_file() -> None:
    values = {"null": None, "true": True, "0.5": 0.5, "[a, b]": ("a", "b"), "auto": "auto"}
    assert {in_yaml(value): value for value in values.values()} == values
