"""The canonical form of a spec reads back as the same spec, as YAML and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree.nodes import Scalar, Table
from spec_schema.yaml_tree.reader import read_tree
from spec_schema.yaml_tree.writer import yaml_text
from tests.spec_schema.test_json_schema import GOOD


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.name)
def test_it_reads_back_as_the_same(path: Path) -> None:
    data = spec_data(read_spec(path).spec)
    # sub-models are looked for beside the file
    assert spec_data(read_spec(path.parent / "again.yaml", yaml_text(data)).spec) == data
    assert spec_data(read_spec(path.parent / "again.json", json.dumps(data)).spec) == data


def test_what_was_not_written_is_there() -> None:
    text = "msnn: 1\nname: a\ninputs: {u: m}\noutputs: {y: u}\ntrain: [{}]\n"
    data = spec_data(read_spec("a.yaml", text).spec)
    assert data["inputs"]["u"] == {"unit": "m", "on_invalid": "flag"}
    assert data["train"][0]["optimizer"] == {
        "adam": {"lr": 0.001, "beta1": 0.9, "beta2": 0.999, "eps": 1e-08}
    }


@given(st.text(max_size=20) | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(-9e9, 9e9))
def test_any_scalar_is_written_so_that_it_reads_back(value: str | float) -> None:
    assume(not isinstance(value, str) or value.isprintable())
    findings = Findings()
    root = read_tree(SourceText("a.yaml", yaml_text({"a": value, "b": [value]})), findings)
    assert findings.in_order == ()
    assert isinstance(root, Table)
    read = root.entries["a"]
    assert isinstance(read, Scalar)
    assert read.value == value
