"""YAML is read by the rules of 1.2 core, by either parser of PyYAML, with exact places."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.render import render
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree import reader
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table, core_value
from spec_schema.yaml_tree.reader import LARGEST, read_tree

FILES = sorted(
    [
        *(Path(__file__).parents[1] / "bad_specs").glob("*.yaml"),
        *(Path(__file__).parents[1] / "bad_specs").glob("*.json"),
        *(Path(__file__).parent / "good").iterdir(),
    ]
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("~", None),
        ("null", None),
        ("true", True),
        ("FALSE", False),
        ("no", "no"),
        ("on", "on"),
        ("y", "y"),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("-7", -7),
        ("1e3", 1000.0),
        ("1e-3", 1e-3),
        ("-.5", -0.5),
        ("+12.", 12.0),
        ("-.inf", float("-inf")),
        ("12:30:45", "12:30:45"),
        ("1_000", "1_000"),
        ("0b1", "0b1"),
        ("2020-01-01", "2020-01-01"),
        ("9" * 5000, float("inf")),
    ],
)
def test_plain_scalar(text: str, value: object) -> None:
    found = core_value(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_both_parsers_say_the_same_of_a_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = path.read_bytes().decode(errors="replace").removeprefix("\ufeff")
    fast = _tree_and_words(path.name, text)
    monkeypatch.delattr(yaml, "CSafeLoader")
    assert _tree_and_words(path.name, text) == fast


def test_a_c_parser_is_tested() -> None:
    # The wheels of PyYAML carry libyaml; without it the test above would compare nothing.
    assert hasattr(yaml, "CSafeLoader")


_LINES = st.lists(st.text("ab+ '\"\\\t#-", max_size=9), min_size=1, max_size=6)


@settings(max_examples=300, deadline=None)
@given(_LINES, st.sampled_from(["|", "|-", "|+", ">", ">-", ">+"]), st.sampled_from(["\n", "\r\n"]))
def test_places_within_block_scalars(lines: list[str], style: str, line_end: str) -> None:
    block = line_end.join("    " + line for line in ["x", *lines])
    _check_places(f"a:\n  b: {style}\n{block}\n  c: 1\n".replace("\n", line_end))


@settings(max_examples=300, deadline=None)
@given(_LINES, st.sampled_from(["'", '"', ""]), st.sampled_from(["\n", "\r\n"]))
def test_places_within_flow_scalars(lines: list[str], quote: str, line_end: str) -> None:
    body = f"{line_end}    ".join(["x", *lines, "y"])
    if quote == "'":
        body = body.replace("'", "''")
    elif quote == '"':
        body = body.replace("\\", "\\\\").replace('"', '\\"').replace("a", "\\x61")
        body = body.replace("b+", "b\\" + line_end + "    +")
    _check_places(f"a:{line_end}  b: {quote}{body}{quote}{line_end}  c: 1{line_end}")


def _check_places(text: str) -> None:
    """Each character of the value of a.b stands where its place says, as itself or as an escape."""
    findings = Findings()
    source = SourceText("places.yaml", text)
    root = read_tree(source, findings)
    if not isinstance(root, Table) or findings.failed:
        return
    inner = root.entries["a"]
    scalar = inner.entries["b"] if isinstance(inner, Table) else None
    if not isinstance(scalar, Scalar):
        return
    oracle: Any = yaml.load(text, Loader=yaml.CSafeLoader)["a"]["b"]
    assert scalar.text == oracle or scalar.value is None or not isinstance(oracle, str)
    offsets = scalar.positions.offsets
    assert len(offsets) == len(scalar.text) + 1
    assert list(offsets) == sorted(offsets)
    for character, offset in zip(scalar.text, offsets, strict=False):
        written = text[offset]
        if character in " \n":
            assert written in " \n\r\t\\"
        else:
            assert written in {character, "\\"}


def test_columns_count_characters() -> None:
    findings = Findings()
    root = read_tree(SourceText("a.yaml", "α: {β: 'γ', δ: ε}\r\nζ: η\r\n"), findings)
    assert isinstance(root, Table)
    span = root.keys["ζ"]
    assert (span.line, span.column, span.end_column) == (2, 1, 2)
    alpha = root.entries["α"]
    assert isinstance(alpha, Table)
    assert (alpha.span.column, alpha.span.end_column) == (4, 18)
    assert (alpha.keys["δ"].column, alpha.entries["δ"].span.column) == (13, 16)


@pytest.mark.parametrize("word", [3, 12_000])
def test_a_bracket_that_goes_wrong_looks_at_few_characters(
    word: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not at all since the bracket: the search begins anew at each of them."""
    pattern, looked_at = reader._WORD_IN_FLOW, list[int]()

    class Counting:
        def search(self, text: str, begin: int, end: int) -> re.Match[str] | None:
            looked_at.append(end - begin)
            return pattern.search(text, begin, end)

    monkeypatch.setattr(reader, "_WORD_IN_FLOW", Counting())
    text = "a: [" + ("b" * word + " ") * (24_000 // word) + "[1]"
    findings = Findings()
    assert read_tree(SourceText("long.yaml", text), findings) is None
    assert [d.code for d in findings.in_order] == ["E0122"]
    (count,) = looked_at
    assert count <= 200


def test_file_above_the_cap_is_refused() -> None:
    findings = Findings()
    assert read_tree(SourceText("a.yaml", "#" * (LARGEST + 1)), findings) is None
    assert [d.code for d in findings.in_order] == ["E0119"]


@pytest.mark.parametrize("opened", ["[", "{a: ", "- ", "? ", "a:\n"])
def test_deep_nesting_is_refused_without_recursion(opened: str) -> None:
    lines = "".join(" " * i + "a:\n" for i in range(900)) if "\n" in opened else opened * 100_000
    findings = Findings()
    assert read_tree(SourceText("a.yaml", lines), findings) is None
    assert findings.failed


def test_json_may_be_deep_no_more_than_yaml() -> None:
    findings = Findings()
    assert read_tree(SourceText("a.json", "[" * 100_000 + "]" * 100_000), findings) is None
    assert [d.code for d in findings.in_order] == ["E0120"]


def test_json_is_read_with_places() -> None:
    result = read_spec(
        "a.json", '{"msnn": 1, "name": "a", "inputs": {"x": "m"},\n"outputs": {"y": "x"}}'
    )
    assert result.spec.outputs["y"].place.key.line == 2


def _tree_and_words(name: str, text: str) -> tuple[object, str]:
    findings = Findings()
    source = SourceText(name, text)
    root = read_tree(source, findings)
    return _plain(root), render(findings.in_order, "full", (source,))


def _plain(node: Node | None) -> object:
    match node:
        case None:
            return None
        case Scalar():
            return (node.text, repr(node.value), node.span, list(node.positions.offsets))
        case Listing():
            return (node.span, [_plain(item) for item in node.items])
        case Table():
            entries = {key: _plain(value) for key, value in node.entries.items()}
            return (node.span, dict(node.keys), entries)
