"""Settings (`--set`) change the value at their path, and nothing beside it."""

from __future__ import annotations

import pytest

from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.reader import read_spec
from spec_schema.reading.setting_values import plain_value
from spec_schema.reading.settings import apply_settings
from spec_schema.yaml_tree.reader import read_tree

TREE = """
data: {source: [a, b, c], deep: {plant: {x: 1}, plant.x: 2, plant.x.y: 3}}
train: [{epochs: 1}, {epochs: 2}, {epochs: 3}]
"""

SPEC = """
msnn: 1
name: plain
sample_time: 1 s
inputs: {u: m}
parameters: {a: {init: 1, min: 0, unit: m}}
outputs: {y: u + a}
"""


def changed(setting: str) -> object:
    findings = Findings()
    tree = read_tree(SourceText("tree.yaml", TREE), findings)
    assert tree is not None
    found = plain_value(apply_settings(tree, [setting], findings))
    assert not findings.failed, findings.in_order
    return found


DEEP = {"plant": {"x": 1}, "plant.x": 2, "plant.x.y": 3}
TRAIN = [{"epochs": 1}, {"epochs": 2}, {"epochs": 3}]


@pytest.mark.parametrize(
    ("setting", "source", "deep", "train"),
    [
        ("data.source.0=z", ["z", "b", "c"], DEEP, TRAIN),
        ("data.source.1=z", ["a", "z", "c"], DEEP, TRAIN),
        ("data.source.2=z", ["a", "b", "z"], DEEP, TRAIN),
        ("data.source=[z]", ["z"], DEEP, TRAIN),
        ("train.1.epochs=9", ["a", "b", "c"], DEEP, [TRAIN[0], {"epochs": 9}, TRAIN[2]]),
        # of names with dots the longest that is there
        ("data.deep.plant.x=9", ["a", "b", "c"], {**DEEP, "plant.x": 9}, TRAIN),
        ("data.deep.plant.x.y=9", ["a", "b", "c"], {**DEEP, "plant.x.y": 9}, TRAIN),
        ("data.deep.plant={x: 9}", ["a", "b", "c"], {**DEEP, "plant": {"x": 9}}, TRAIN),
    ],
)
def test_one_value_changes(setting: str, source: object, deep: object, train: object) -> None:
    assert changed(setting) == {"data": {"source": source, "deep": deep}, "train": train}


@pytest.mark.parametrize(
    "setting", ["parameters.b=1", "inputs.v=m", "outputs={z: u}", "parameters={a: 1, c: 2}"]
)
def test_names_of_a_model_are_neither_added_nor_removed(setting: str) -> None:
    with pytest.raises(SpecError) as caught:
        read_spec("plain.msnn.yaml", SPEC, [setting])
    assert "E1031" in {found.code for found in caught.value.diagnostics}


@pytest.mark.parametrize("number", ["1e999 m", "-1e999 m", "1e999", ".inf", ".nan"])
def test_numbers_beyond_floats_are_refused_with_and_without_a_unit(number: str) -> None:
    with pytest.raises(SpecError) as caught:
        read_spec("plain.msnn.yaml", SPEC, [f"parameters.a.min={number}"])
    (found,) = caught.value.diagnostics
    assert found.span is not None
    assert found.span.file == "--set"
