"""A repair that an editor offers does away with what it repairs."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.features.language_server.knowledge import Examined, examine
from msnn.features.language_server.positions import START, Position, TextRange
from msnn.features.language_server.problems import Repair, problems_of, repairs_of
from spec_schema.diagnostics.source import SourceText
from tests.features.language_server.test_diagnostics import SPECS, text_of

_EVERYTHING = TextRange(START.start, Position(10**6, 0))


def test_every_repair_of_a_broken_spec_repairs_it():
    repaired: set[str] = set()
    for path in SPECS:
        text = text_of(path)
        before = examine(str(path), text or "", {})
        for repair in repairs(before, path):
            said = repair.problem.diagnostic.message
            after = examine(str(path), with_repair(text or "", repair), {})
            assert _times(said, after) < _times(said, before), f"{path.name}: {repair.title}"
            repaired.add(repair.problem.diagnostic.code)
    assert {"E0201", "E0207", "E0211", "E0301", "E0321", "E0734"} <= repaired


def _times(message: str, examined: Examined) -> int:
    return sum(found.message == message for found in examined.diagnostics)


def test_only_a_problem_that_is_selected_is_repaired(tmp_path: Path):
    text = "msnn: 1\nname: m\ninputs: {uu: {}}\noutputs:\n  y: 2 * uv\n  z: 3 * vu\n  w: 4 * uw\n"
    path = tmp_path / "m.msnn.yaml"
    problems = problems_of(examine(str(path), text, {}), str(path))
    assert len(list(repairs_of(problems, str(path), _EVERYTHING))) == 3
    line = TextRange(Position(5, 0), Position(5, 9))
    (repair,) = repairs_of(problems, str(path), line)
    assert repair.problem.range == TextRange(Position(5, 9), Position(5, 11))


def test_what_is_wrong_in_another_file_is_not_repaired_in_this_one(tmp_path: Path):
    part, whole = tmp_path / "part.msnn.yaml", tmp_path / "whole.msnn.yaml"
    part.write_text("msnn: 1\nname: part\ninputs: {u: {}}\noutputs: {y: 2 * uu}\n")
    text = "msnn: 1\nname: whole\nuse: {p: part.msnn.yaml}\n"
    text += "inputs: {a: {}}\nconnect: {p.u: a}\noutputs: {z: p.y}\n"
    examined = examine(str(whole), text, {})
    assert [found.replacement for found in examined.diagnostics] == ["u"]
    assert not repairs(examined, whole)


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_a_place_counts_utf_16_units(tmp_path: Path, line_end: str):
    lines = ["msnn: 1", "name: m", "inputs: {u: {doc: a}}", "outputs: {y: {doc: 𝛼𝛽, expr: uu}}", ""]
    text = line_end.join(lines)
    path = tmp_path / "m.msnn.yaml"
    (repair,) = repairs(examine(str(path), text, {}), path)
    assert repair.problem.range == TextRange(Position(3, 31), Position(3, 33))
    assert "expr: u}" in with_repair(text, repair)


def repairs(examined: Examined, path: Path) -> list[Repair]:
    """All that are offered."""
    return list(repairs_of(problems_of(examined, str(path)), str(path), _EVERYTHING))


def with_repair(text: str, repair: Repair) -> str:
    """The text with an edit as an editor makes it."""
    units = text.encode("utf-16-le")
    source = SourceText("", text)
    starts = [0]
    for number in range(1, source.line_count):
        starts.append(text.index(source.line(number), starts[-1]) + len(source.line(number)))
        starts[-1] += 2 if text.startswith("\r\n", starts[-1]) else 1
    first, last = (
        len(text[: starts[place.line]].encode("utf-16-le")) + 2 * place.character
        for place in (repair.problem.range.start, repair.problem.range.end)
    )
    return (units[:first] + repair.text.encode("utf-16-le") + units[last:]).decode("utf-16-le")
