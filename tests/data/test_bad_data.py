"""Every fault of a data file gives its sentence, with file and row."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.data.reading.load import load_data
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.render import render
from tests.data.specs import data_section
from tests.golden import assert_golden
from tests.programs import fir_closed_loop

FOLDER = Path(__file__).parents[1] / "bad_data"
GOOD = {"good", "comment_line"}
CASES = sorted(path.stem for path in FOLDER.glob("*.csv") if path.stem not in GOOD)


def section(*cases: str, more: str = "") -> str:
    files = ", ".join(f"{case}.csv" for case in cases)
    return f"source: {{train: [{files}]}}\ntime: time\n{more}"


@pytest.mark.parametrize("case", CASES)
def test_message(case: str, accept: bool) -> None:
    with pytest.raises(SpecError) as caught:
        load_data(fir_closed_loop().program, data_section(section(case)), FOLDER)
    error = caught.value
    text = render(error.diagnostics, "full", error.sources) + "\n"
    assert_golden(FOLDER / f"{case}.txt", text, accept)


def test_all_bad_files_are_reported_at_once() -> None:
    cases = ("missing_column", "good", "empty", "time_gap")
    with pytest.raises(SpecError) as caught:
        load_data(fir_closed_loop().program, data_section(section(*cases)), FOLDER)
    assert {d.code for d in caught.value.diagnostics} == {"E0804", "E0803", "E0811"}


def test_comment_lines_are_passed_over() -> None:
    more = 'csv: {comment: "#"}\n'
    program = fir_closed_loop().program
    data = load_data(program, data_section(section("comment_line", more=more)), FOLDER)
    assert data.rows == 2
