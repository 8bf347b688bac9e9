"""The JSON Schema accepts every good spec, refuses broken ones where it can, and suits editors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator

from msnn.project.new_project import new_project
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.editors.json_schema import json_schema, json_schema_text, key_doc
from spec_schema.fields.entry import kinds_within
from spec_schema.sections.data import Layout
from spec_schema.sections.exports import CExport, OnnxExport, TargetEntry, TorchExport
from spec_schema.sections.spec import Spec
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar
from spec_schema.yaml_tree.reader import read_tree
from tests.examples.gallery import EXAMPLES

ROOT = Path(__file__).parents[2]
SCHEMA = json_schema()
VALIDATOR = Draft7Validator(SCHEMA)
GOOD = sorted(
    [
        *(Path(__file__).parent / "good").iterdir(),
        *EXAMPLES,
        *ROOT.glob("tests/golden/**/*.msnn.yaml"),
    ]
)
# Whether keys fit each other, and what a text or a number means, is beyond a schema.
BEYOND = {"E0208", "E0219", "E0222", "E0223", "E0224", "E0225", "E0226", "E0228"}
NOT_EXPRESSIBLE = {
    "E0203_no_centers",
    "E0209_two_variants",
    "E0210_nan",
    "E0210_not_finite",
    "E0210_limit_beyond_floats",
    "E0210_range_without_width",
    "E0210_sample_time_of_nothing",
}
BROKEN = [
    path
    for path in sorted((ROOT / "tests" / "bad_specs").glob("E02*.yaml"))
    if path.stem[:5] not in BEYOND
]


def test_it_is_a_schema() -> None:
    Draft7Validator.check_schema(SCHEMA)
    assert json.loads(json_schema_text()) == SCHEMA


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.name)
def test_good_specs_are_accepted(path: Path) -> None:
    errors = [
        f"{list(error.absolute_path)}: {error.message[:200]}"
        for error in VALIDATOR.iter_errors(_values(path))
    ]
    assert errors == []


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.name)
def test_broken_specs_are_refused_where_a_schema_can_tell(path: Path) -> None:
    assert VALIDATOR.is_valid(_values(path)) == (path.stem in NOT_EXPRESSIBLE)


def test_nothing_leaves_an_editor_in_doubt() -> None:
    """With `oneOf` or `anyOf` an editor offers the keys of all variants and explains none."""
    for schema in _parts(SCHEMA):
        assert not {"oneOf", "anyOf", "allOf", "if"} & set(schema)


def test_every_key_says_what_it_is_for() -> None:
    silent = [
        f"{entry.__name__}.{key}"
        for entry in kinds_within(Spec)
        for key in entry.known_keys()
        if not key_doc(entry, key)
    ]
    assert silent == [], "write their lines below their fields"


def test_a_key_is_explained_by_the_text_below_its_field() -> None:
    """Also where the key is no name of Python, or a base has the field."""
    assert key_doc(Layout, "from") == "First row (from 0), time or date that is used."
    assert key_doc(TorchExport, "outputs") == key_doc(TargetEntry, "outputs") != ""
    assert key_doc(CExport, "dtype") != key_doc(OnnxExport, "dtype")


def test_patterns_read_alike_in_javascript() -> None:
    for schema in _parts(SCHEMA):
        pattern = schema.get("pattern")
        if isinstance(pattern, str):
            assert not re.search(r"\\w|\(\?P|\(\?<|\\A|\\Z", pattern), pattern


@pytest.mark.parametrize(
    ("name", "good"), [("θ_1", True), ("µ", True), ("lambda", False), ("2nd", False), ("t", False)]
)
def test_names(name: str, good: bool) -> None:
    spec = {"msnn": 1, "name": "a", "inputs": {name: "m"}, "outputs": {"y": 1}}
    assert VALIDATOR.is_valid(spec) is good


def test_reserved_keys_are_marked_and_refused() -> None:
    for kind in kinds_within(Spec):
        definition = SCHEMA if kind is Spec else SCHEMA["definitions"][kind.__name__]
        for key in kind.later:
            reserved = definition["properties"][key]
            assert "planned" in reserved["description"]
            assert not Draft7Validator(reserved).is_valid(1)


def test_a_new_project_brings_the_schema_that_its_spec_names(tmp_path: Path) -> None:
    folder = new_project(tmp_path / "plant")
    first = (folder / "plant.msnn.yaml").read_text().splitlines()[0]
    assert (folder / first.partition("$schema=")[2]).read_text() == json_schema_text()
    assert VALIDATOR.is_valid(_values(folder / "plant.msnn.yaml"))


def _values(path: Path) -> Any:
    findings = Findings()
    text = path.read_text(encoding="utf-8").removeprefix("\ufeff")
    root = read_tree(SourceText(str(path), text), findings)
    assert root is not None
    return _value(root)


def _value(node: Node) -> Any:
    match node:
        case Scalar(value=value):
            return value
        case Listing(items=items):
            return [_value(item) for item in items]
        case _:
            return {key: _value(value) for key, value in node.entries.items()}


def _parts(schema: Any) -> Iterator[dict[str, Any]]:
    if isinstance(schema, dict):
        yield schema
    inner = schema.values() if isinstance(schema, dict) else schema
    for part in inner if isinstance(schema, dict | list) else ():
        yield from _parts(part)
