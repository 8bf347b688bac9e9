"""A spec in JSON gets the same diagnostics as in YAML, each at its place in the JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from compiler.elaboration.compile import compile_spec
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.reader import read_file, read_spec
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar
from spec_schema.yaml_tree.reader import read_tree

# YAML's own faults (E01) have no JSON, and neither have NaN and infinity.
NOT_IN_JSON = {"E0210_nan", "E0210_not_finite", "E0731_itself"}  # the last names its own file
BROKEN = [
    path
    for path in sorted((Path(__file__).parents[1] / "bad_specs").glob("[EW]0[2-9]*.yaml"))
    if path.stem not in NOT_IN_JSON
]


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_the_same_is_said(path: Path) -> None:
    source = read_file(path)
    findings = Findings()
    root = read_tree(source, findings)
    assert root is not None
    text = json.dumps(_value(root), ensure_ascii=False, indent=2)
    # nothing is there under this name; files that the spec names are looked for beside it
    name = str(path.with_suffix(".json"))
    in_json = _said(name, text)
    assert sorted(_sentence(d) for d in in_json) == sorted(
        _sentence(d) for d in _said(str(path), source.text)
    )
    lines = SourceText(name, text)
    for diagnostic in in_json:
        span = diagnostic.span
        in_part = span is not None and Path(span.file).parent.name == "parts"
        assert span is None or in_part or (span.file, span.line <= lines.line_count) == (name, True)


def _said(path: str, text: str) -> tuple[Diagnostic, ...]:
    try:
        read = read_spec(path, text)
        return (*read.warnings, *compile_spec(read.spec, used=read.used).warnings)
    except SpecError as error:
        return error.diagnostics


def _sentence(diagnostic: Diagnostic) -> tuple[str, str]:
    return diagnostic.code, diagnostic.message


def _value(node: Node) -> Any:
    match node:
        case Scalar(value=value):
            assert not isinstance(value, float) or math.isfinite(value)
            return value
        case Listing(items=items):
            return [_value(item) for item in items]
        case _:
            return {key: _value(item) for key, item in node.entries.items()}
