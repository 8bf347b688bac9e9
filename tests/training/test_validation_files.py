"""`files:` of a validate entry: other files than the data of the spec, with the same rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn import load
from msnn.project.workflow_checks import check_workflow
from msnn.validation.validate import ValidationReport
from spec_schema.diagnostics.diagnostic import SpecError

HEAD = """\
msnn: 1
name: gain
sample_time: 0.1 s
inputs: {u: m, y: m}
parameters: {a: {init: 0.5, learn: true}}
outputs: {next: {expr: a * u, predicts: "y[t+1]"}}
"""
DATA = "data: {source: {train: a.csv}, columns: {u: in}}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """In `a.csv` y[t+1] is 0.5 u[t], in `wet/b.csv` it is 0.5 u[t] + 1, in `wet/c.csv` + 3."""
    (tmp_path / "wet").mkdir()
    for name, offset, rows in (("a", 0.0, 20), ("wet/b", 1.0, 10), ("wet/c", 3.0, 10)):
        u = np.arange(rows, dtype=float)
        y = np.concatenate([[0.0], 0.5 * u[:-1] + offset])
        text = "in,y\n" + "".join(f"{a},{b}\n" for a, b in zip(u, y, strict=True))
        (tmp_path / f"{name}.csv").write_text(text)
    return tmp_path


def _report(folder: Path, checks: str, data: str = DATA) -> ValidationReport:
    path = folder / "gain.msnn.yaml"
    path.write_text(f"{HEAD}{data}validate:\n{checks}")
    return msnn.validate(msnn.load(path))


def test_files_are_measured_instead_of_a_set(folder: Path) -> None:
    report = _report(
        folder,
        """\
  - {of: next, metric: mae}
  - {of: next, metric: mae, files: wet/b.csv}
  - {of: next, metric: mae, files: wet/*.csv, max: 1.5 m}
""",
    )
    assert [row.value for row in report.rows] == [0.0, 1.0, 2.0]
    assert [row.data for row in report.rows] == ["train", "wet/b.csv", "wet/*.csv"]
    assert report.rows[1].rows == "rows 1…9 of 10"
    assert [row.passed for row in report.rows] == [None, None, False]


def test_keys_of_a_source_hold_for_files(folder: Path) -> None:
    checks = """\
  - {of: next, metric: max_abs, files: {files: wet/b.csv, from: 2, to: 5}}
  - {of: next, metric: max_abs, files: {files: wet/b.csv, columns: {u: y}}}
  - {of: next, metric: rmse, files: {files: wet/b.csv, from: 2, to: 5}}
"""
    first, second, third = _report(folder, checks).rows
    assert (first.data, first.rows) == ("wet/b.csv", "rows 1…3 of 4")
    assert second.data == "wet/b.csv (2)"
    assert second.value == pytest.approx(5 - 0.5 * 4.5)  # of the last two rows of y
    assert third.data == first.data


def test_the_data_section_is_not_needed_where_all_entries_have_files(folder: Path) -> None:
    files = "{files: wet/c.csv, columns: {u: in}}"
    (row,) = _report(folder, f"  - {{of: next, metric: mae, files: {files}}}\n", data="").rows
    assert row.value == 3.0


def test_a_split_does_not_touch_files(folder: Path) -> None:
    data = (
        "data: {source: {log: a.csv}, columns: {u: in}, "
        "split: {by: fraction, train: 0.5, test: 0.5}}\n"
    )
    checks = "  - {of: next, metric: mae, files: wet/b.csv}\n  - {of: next, metric: mae}\n"
    first, second = _report(folder, checks, data).rows
    assert (first.rows, first.value) == ("rows 1…9 of 10", 1.0)
    assert second.data == "test"


def test_a_set_of_the_same_name_is_another(folder: Path) -> None:
    checks = "  - {of: next, metric: mae, data: wet}\n  - {of: next, metric: mae, files: wet}\n"
    data = "data: {source: {wet: a.csv}, columns: {u: in}}\n"
    assert [row.value for row in _report(folder, checks, data).rows] == [0.0, 2.0]


def test_a_file_that_is_wrong_is_said_as_of_data(folder: Path) -> None:
    (folder / "wet" / "b.csv").write_text("in,y\n1,2\n2,x\n")
    with pytest.raises(SpecError) as found:
        _report(folder, "  - {of: next, files: wet/b.csv}\n")
    (fault,) = found.value.diagnostics
    assert fault.span is not None
    assert (fault.code, fault.span.file, fault.span.line) == ("E0807", "wet/b.csv", 3)
    with pytest.raises(SpecError) as found:
        _report(folder, "  - {of: next, files: dry/*.csv}\n")
    assert [fault.code for fault in found.value.diagnostics] == ["E0801"]


def test_check_looks_at_the_keys_of_files(tmp_path: Path) -> None:
    path = tmp_path / "gain.msnn.yaml"
    checks = """\
  - {of: next, files: {files: wet.csv, columns: {z: pos}, filter: w > 2}}
  - {of: next}
"""
    path.write_text(f"{HEAD}validate:\n{checks}")
    found = [(fault.code, fault.span and fault.span.line) for fault in check_workflow(load(path))]
    assert found == [("E0952", 8), ("E0301", 8), ("E0954", 9)]


def test_a_limit_in_kelvin_is_that_of_a_difference_in_degrees(folder: Path) -> None:
    path = folder / "gain.msnn.yaml"
    checks = "  - {of: next, metric: mae, files: wet/b.csv, max: 1.5 K}\n"
    text = f"{HEAD}{DATA}validate:\n{checks}".replace("y: m}", "y: degC}")
    path.write_text(text.replace("expr: a * u", "expr: a * u, unit: degC"))
    (row,) = msnn.validate(msnn.load(path)).rows
    assert (row.maximum, row.passed) == (1.5, True)
