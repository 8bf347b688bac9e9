"""Formatting changes no meaning, is done after one pass, and keeps comments."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.format_spec import format_spec
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import read_spec
from tests.spec_schema.test_json_schema import GOOD

HEAD = "msnn: 1\nname: a\n"
PIECES = {
    "doc": "doc: |\n  two\n\n\n  lines  \n",
    "sample": "sample_time: 50 ms   \n",
    "inputs": "# about inputs\n# in two lines\ninputs:\n  u: m   # the input\n\n\n  v: m\n",
    "parameters": "\n\nparameters: {k: 1}\n",
    "equations": "equations:\n    e: u\n      + v\n",
    "outputs": "outputs: {y: k * u + e}\n# the end\n",
    "train": "train:\n- {epochs: 1}\n\n",
    "data": "data: {source: {train: 'a.csv'}}\n",
    "x": "x-note: {b: 1, a: [2, 3]}\n",
}


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.name)
def test_good_specs_mean_the_same_and_are_stable(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    _assert_kept(str(path), text, format_spec(str(path), text))


@given(st.permutations(list(PIECES.values())), st.sampled_from(["\n", "\r\n"]))
def test_any_order_of_sections(pieces: list[str], end: str) -> None:
    text = (HEAD + "".join(pieces)).replace("\n", end)
    formatted = format_spec("a.yaml", text)
    _assert_kept("a.yaml", text, formatted)
    lines = formatted.splitlines()
    at = lines.index("inputs:")
    assert lines[at - 2 : at] == ["# about inputs", "# in two lines"]
    assert lines.index("inputs:") < lines.index("outputs: {y: k * u + e}") < lines.index("train:")
    assert "  lines  " in lines, "blanks within a text belong to it"
    assert formatted.count("#") == text.count("#")


def _assert_kept(name: str, text: str, formatted: str) -> None:
    assert spec_data(read_spec(name, formatted).spec) == spec_data(read_spec(name, text).spec)
    assert format_spec(name, formatted) == formatted
    assert "\n\n\n" not in formatted.replace("two\n\n\n", "")
    assert formatted.endswith("\n")


def test_the_order_of_the_grammar() -> None:
    text = "outputs: {y: u}\n# what goes in\ninputs:\n  u: m\nname: a\nmsnn: 1\n"
    assert format_spec("a.yaml", text) == (
        "msnn: 1\nname: a\n\n# what goes in\ninputs:\n  u: m\n\noutputs: {y: u}\n"
    )


def test_a_header_stays_on_top() -> None:
    text = "# a model\noutputs: {y: u}\ninputs: {u: m}\nname: a\nmsnn: 1\n"
    assert format_spec("a.yaml", text).startswith("# a model\n")


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("{expr: u, predicts: u[t+1]}", '{expr: u, predicts: "u[t+1]"}'),
        ("{expr: max(u, sin(2)), unit: m}", '{expr: "max(u, sin(2))", unit: m}'),
    ],
)
def test_what_yaml_would_misread_is_quoted(wrong: str, right: str) -> None:
    text = HEAD + "sample_time: 1 s\ninputs: {u: m}\noutputs:\n  y: "
    formatted = format_spec("a.yaml", f"{text}{wrong}\n")
    assert f"  y: {right}\n" in formatted
    assert format_spec("a.yaml", formatted) == formatted


def test_a_glob_is_quoted() -> None:
    text = HEAD + "inputs: {u: m}\noutputs: {y: u}\ndata: {source: {train: *.csv}}\n"
    assert '{train: "*.csv"}' in format_spec("a.yaml", text)


def test_anchors_keep_their_order() -> None:
    text = HEAD + "x-unit: &unit m\noutputs: {y: u}\ninputs: {u: *unit}\n"
    formatted = format_spec("a.yaml", text)
    assert spec_data(read_spec("a.yaml", formatted).spec)["inputs"]["u"]["unit"] == "m"
    assert format_spec("a.yaml", formatted) == formatted


def test_json() -> None:
    text = '{"outputs": {"y": "μ"}, "inputs": {"μ": "m"}, "name": "a", "msnn": 1}'
    formatted = format_spec("a.json", text)
    assert formatted.startswith('{\n  "msnn": 1,\n  "name": "a",\n  "inputs": {\n    "μ": "m"')
    assert format_spec("a.json", formatted) == formatted


def test_errors_are_refused() -> None:
    with pytest.raises(SpecError) as caught:
        format_spec("a.yaml", HEAD + "inputs: {u: m}\noutputs:\n  y: (u\n")
    assert [d.code for d in caught.value.diagnostics] == ["E0322"]
