"""Edit scripts: parsing, round trips, and one sentence for everything that is wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image

from spmm_torch import SPMM, ConfigError, SPMMError
from spmm_torch.edit import (
    EDITS,
    Rectangle,
    Script,
    Selection,
    Step,
    cluster_selection,
    hue_saturation,
    lobe_selection,
    scale_width,
    select_texels,
    spread_normals,
)
from spmm_torch.edit.entries import from_entries, scaled_entries
from spmm_torch.edit.parts import with_parts
from spmm_torch.runtime import tensor_file
from tests.edit.looks import check_valid, look

EVERYTHING = """
- intensity: {factor: 1.5, group: specular, threshold: 0.6}
- hue_saturation: {hue: -110, saturation: 0.5, fit: unit}
- scale_width: {factor: 0.5, keep_energy: true, mask: {cluster: {number: 1}}}
- spread_normals: {factor: 1.6, mask: {not: {rectangle: {x: 1, y: 2, width: 3, height: 4}}}}
- rotate_tangent: {angle: 30}
- residual_strength: {factor: 0.5}
- set_parameter: {name: f0, value: 0.5, mask: {lobes: {models: [cook_torrance]}}}
- replace_model: {name: ward, group: specular}
- copy_look:
    x: 0
    y: 0
    width: 2
    height: 2
    mask:
      any:
        - colour: {low: [0, 0, 0], high: [0.2, 9, 9], soft: 0.1, light: [30, 0]}
        - all: [{stripes: {count: 2, share: 0.3}}, {cluster: {number: [0, 1]}}]
- intensity: {mask: {lobes: {specular: true, width: [0, 0.3], elevation: [60, 90]}}}
"""


def parse(text: str) -> Script:
    return Script.parse(yaml.safe_load(text))


def test_scripts_round_trip(model: SPMM) -> None:
    script = parse(EVERYTHING)
    again = parse(script.to_yaml())
    assert again == script
    edited = script.apply(model)
    assert torch.equal(look(again.apply(model)), look(edited))
    check_valid(edited)


def test_defaults_are_left_out() -> None:
    script = parse("- intensity: {factor: 1.0, group: all}\n- hue_saturation:\n")
    assert script.plain() == [{"intensity": {}}, {"hue_saturation": {}}]
    assert parse("") == Script()


def test_a_script_does_what_its_functions_do(model: SPMM) -> None:
    script = parse(
        "- spread_normals: {factor: 1.6}\n"
        "- hue_saturation: {hue: 90, mask: {rectangle: {x: 0, y: 0, width: 3, height: 8}}}\n"
        "- scale_width: {factor: 0.5, mask: {all: [{cluster: {number: 1}}, "
        "{lobes: {elevation: [80, 90]}}]}}\n"
    )
    expected = spread_normals(model, 1.6)
    where = select_texels(expected, Rectangle(0, 0, 3, 8).mask(expected))
    expected = hue_saturation(expected, math.pi / 2.0, where=where)
    number = sorted(set(expected.labels[:8].tolist()))  # of clusters, which the mask has split
    assert len(number) > 1
    upright = (math.radians(80.0), math.pi / 2.0)
    where = cluster_selection(expected, [1]) & lobe_selection(expected, elevation=upright)
    expected = scale_width(expected, 0.5, where)
    assert torch.equal(look(script.apply(model)), look(expected))


def test_paths_are_relative_to_the_script(model: SPMM, tmp_path: Path) -> None:
    codes = np.zeros((8, 8), dtype=np.uint8)
    codes[:4] = 255
    Image.fromarray(codes).save(tmp_path / "top.png")
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    (tmp_path / "edits.yaml").write_text(
        "- intensity: {factor: 2, mask: {picture: {path: top.png}}}\n"
        "- blend: {path: ., amount: 0.5}\n"
    )
    edited = Script.read(tmp_path / "edits.yaml").apply(model)
    torch.testing.assert_close(look(edited)[:, :32], 1.5 * look(model)[:, :32])
    torch.testing.assert_close(look(edited)[:, 32:], look(model)[:, 32:])


def test_progress(model: SPMM) -> None:
    told: list[int] = []
    parse("- intensity: {factor: 2}\n- rotate_tangent: {angle: 3}").apply(model, told.append)
    assert told == [1, 1]


WRONG = [
    ("intensity: {factor: 2}", "holds sections with keys; expected a list of edits"),
    ("hello", "an edit script holds text; expected a list of edits"),
    ("- intensity", "edit 1 is 'intensity'; expected one edit with its options"),
    ("- {intensity: {}, blend: {}}", "expected one edit with its options"),
    ("- intensty: {factor: 2}", "edit 1: unknown edit intensty; did you mean intensity"),
    ("- intensity: {facto: 2}", "intensity.facto; did you mean edit 1: intensity.factor"),
    ("- intensity: {factor: -2}", "intensity.factor is -2.0; expected 0.0 to 100.0"),
    ("- intensity: {factor: big}", "intensity.factor is 'big'; expected a number"),
    ("- intensity: 3", "intensity is 3; expected a section with keys like factor"),
    ("- intensity: {group: speculr}", "did you mean specular"),
    ("- hue_saturation: {saturation: 3}", "saturation is 3.0; expected 0.0 to 2.0"),
    ("- set_parameter: {name: f0}", "set_parameter.value is missing; expected its value"),
    ("- intensity: {mask: 3}", "intensity.mask is 3; expected one kind of mask"),
    ("- intensity: {mask: {rectangl: 3}}", "unknown mask .*rectangl; did you mean rectangle"),
    ("- intensity: {mask: {rectangle: {x: 1}}}", "rectangle.y is missing; expected the topmost"),
    ("- intensity: {mask: {any: []}}", "mask.any is .*; expected a list of masks"),
    ("- intensity: {mask: {not: {claster: {}}}}", "unknown mask .*claster; did you mean cluster"),
    ("- intensity: {mask: {lobes: {models: [wart]}}}", "is 'wart'; .*did you mean ward"),
]


@pytest.mark.parametrize(("text", "complaint"), WRONG)
def test_what_cannot_be_parsed(text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        parse(text)


NOT_HERE = [
    ("intensity: {mask: {rectangle: {x: 7, y: 0, width: 4, height: 1}}}", "reaches out of"),
    ("intensity: {mask: {cluster: {number: 7}}}", "cluster 7 does not exist"),
    ("intensity: {mask: {picture: {path: no.png}}}", "mask no.png cannot be read"),
    ("intensity: {mask: {lobes: {width: [2, 1]}}}", "width is .*; expected two numbers"),
    ("intensity: {mask: {colour: {low: 0, high: 1}}}", "expected 3 numbers each"),
    (
        "intensity: {mask: {colour: {low: [0, 0, 0], high: [1, 1, 1], view: [95, 0]}}}",
        "the view of a colour mask is .*theta from 0 to below 90",
    ),
    ("scale_width: {threshold: 0.001}", "has no specular lobes"),
    ("set_parameter: {name: exponen, value: 3}", "did you mean exponent"),
    ("blend: {path: nowhere}", "nowhere.* does not exist"),
]


@pytest.mark.parametrize(("text", "complaint"), NOT_HERE)
def test_what_a_model_does_not_have(model: SPMM, text: str, complaint: str) -> None:
    """The sentence begins with the number and the name of the edit."""
    script = parse(f"- residual_strength: {{factor: 0.5}}\n- {text}")
    name = text.partition(":")[0]
    with pytest.raises(SPMMError, match=rf"^edit 2 \({name}\): .*{complaint}"):
        script.apply(model)


def test_files_that_are_no_scripts(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        Script.read(tmp_path / "missing.yaml")
    (tmp_path / "bad.yaml").write_text("- [")
    with pytest.raises(ConfigError, match="is not valid YAML"):
        Script.read(tmp_path / "bad.yaml")


def test_an_unknown_mask_is_told_with_its_place() -> None:
    with pytest.raises(ConfigError) as caught:
        parse("- blend: {path: x}\n- intensity: {mask: {not: {region: {}}}}")
    assert str(caught.value).startswith(
        "edit 2: intensity.mask.not names the unknown mask region; valid: "
    )


@dataclass(frozen=True)
class Planted:
    """An edit that multiplies weights by any number."""

    factor: float

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        weights = replace(model.sparse_weights, weight=self.factor * model.weight.detach())
        return with_parts(model, weights=weights)


@pytest.mark.parametrize("factor", [-5.0, -1e-6, math.inf, math.nan])
def test_an_edit_that_makes_invalid_weights_is_refused(
    model: SPMM, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EDITS, "planted", Planted)
    script = Script((Step(Planted(2.0)), Step(Planted(factor))))
    complaint = r"^edit 2 \(planted\): it makes weights of .*; expected finite weights not below 0"
    with pytest.raises(ConfigError, match=complaint):
        script.apply(model)


def test_a_model_without_lobes_can_be_edited(model: SPMM) -> None:
    nothing = select_texels(model, torch.zeros(8, 8))
    bare = from_entries(model, model.dictionary, [scaled_entries(model, nothing.entries)])
    assert not len(bare.weight)
    assert not len(parse("- intensity: {factor: 2}").apply(bare).weight)
