"""What an editor underlines is what `msnn check` says, of every broken spec."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from msnn.cli.application import run
from msnn.features.language_server.knowledge import examine
from msnn.features.language_server.positions import START, Position, TextRange
from msnn.features.language_server.problems import Problem, problems_of
from spec_schema.diagnostics.diagnostic import Diagnostic

BROKEN = sorted((Path(__file__).parents[2] / "bad_specs").glob("*.*"))
SPECS = [path for path in BROKEN if path.suffix in (".yaml", ".json")]


@pytest.mark.parametrize("first", range(0, len(SPECS), 40))
def test_problems_are_those_of_check(first: int, capsys: pytest.CaptureFixture[str]):
    specs = SPECS[first : first + 40]
    run(["check", "--format", "json", *map(str, specs)])
    records = json.loads(capsys.readouterr().out)["files"]
    for path, record in zip(specs, records, strict=True):
        text = text_of(path)
        if text is None:
            continue  # an editor cannot show what is no text
        problems = problems_of(examine(str(path), text, {}), str(path))
        wanted = [_wanted(found, path, text) for found in record["diagnostics"]]
        assert [_shown(problem) for problem in problems] == wanted, path.name


def text_of(path: Path) -> str | None:
    """The text of a file as an editor has it, line ends and all."""
    try:
        return path.read_bytes().decode().removeprefix("\ufeff")
    except UnicodeDecodeError:
        return None


def _shown(problem: Problem) -> tuple[Any, ...]:
    found: Diagnostic = problem.diagnostic
    return found.code, found.severity, found.message, problem.range


def _wanted(record: Mapping[str, Any], path: Path, text: str) -> tuple[Any, ...]:
    places = [record["place"], *(each["place"] for each in record["secondary"])]
    here = next((p for p in places if p is not None and p["file"] == str(path)), None)
    range = START if here is None or record["place"] is None else _range(here, text)
    return record["code"], record["severity"], record["message"], range


def _range(place: Mapping[str, int], text: str) -> TextRange:
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    ends = ((place[f"{end}line"], place[f"{end}column"]) for end in ("", "end_"))
    start, end = (
        Position(line - 1, len(lines[line - 1][: column - 1].encode("utf-16-le")) // 2)
        for line, column in ends
    )
    return TextRange(start, end)


def test_an_open_sub_model_holds_as_it_is_typed(tmp_path: Path):
    part, whole = tmp_path / "part.msnn.yaml", tmp_path / "whole.msnn.yaml"
    part.write_text(_PART)
    assert not examine(str(whole), _WHOLE, {}).diagnostics
    unsaved = {str(part.resolve()): _PART.replace("2 * u", "2 * v")}
    (problem,) = problems_of(examine(str(whole), _WHOLE, unsaved), str(whole))
    assert problem.diagnostic.code == "E0301"
    assert problem.range.start == Position(2, 9), "where the sub-model is used"
    assert problem.text.startswith(f"{part}:5:10: unknown name `v`")
    assert problem.related[0].path == str(part)


_PART = """\
msnn: 1
name: part
inputs: {u: {}}
outputs:
  y: 2 * u
"""
_WHOLE = """\
msnn: 1
name: whole
use: {p: part.msnn.yaml}
inputs: {a: {}}
connect:
  p.u: a
outputs:
  z: p.y
"""
