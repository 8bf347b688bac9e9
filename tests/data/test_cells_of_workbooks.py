"""The number formats of all cells of a workbook's column state its unit, not that of the first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import openpyxl
import pytest

from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.unit_files import load

PERCENT, SPEED, PLAIN = "0%", '0.0 "km/h"', "General"
LAYOUT = "  time: time\n"


def write(path: Path, header: str, formats: Sequence[str | None], above: int = 0) -> None:
    """A sheet whose cell in row i has the number i + 1 in a format; None leaves the cell empty."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for _ in range(above):
        sheet.append([1.0, 2.0])
        sheet.cell(sheet.max_row, 2).number_format = '0 "kg"'
    sheet.append(["time", header])
    for row, format in enumerate(formats):
        sheet.append([0.1 * row, None if format is None else row + 1.0])
        if format is not None:
            sheet.cell(sheet.max_row, 2).number_format = format
    book.save(path)


@pytest.mark.parametrize(
    ("header", "formats", "unit", "notes"),
    [
        ("v", [PERCENT, PERCENT, PLAIN, PLAIN], "1", ["1: cell B2 and 1 more", "no unit: cell B4"]),
        ("v", [PLAIN, PERCENT, PERCENT], "1", ["no unit: cell B2", "1: cell B3 and 1 more"]),
        ("v", [PLAIN, SPEED, SPEED], "m/s", ["no unit: cell B2", "km/h: cell B3 and 1 more"]),
        ("v", [SPEED, '0.0 "m/s"'], "m/s", ["km/h: cell B2", "m/s: cell B3"]),
        ("v [km/h]", [SPEED, '0.0 "m/s"', PLAIN], "m/s", ["km/h: cell B2", "m/s: cell B3"]),
        ("v (filtered)", [SPEED, PLAIN], "m/s", ["km/h: cell B2", "no unit: cell B3"]),
        ("v", [SPEED, '0 "furlong"'], "m/s", ["km/h: cell B2", "furlong: cell B3"]),
        ("v [%]", [PERCENT, PLAIN], "1", ["1: cell B2", "%: cell B3"]),
        # far below
        ("v", [PLAIN] * 150 + [PERCENT], "1", ["no unit: cell B2", "1: cell B152"]),
    ],
)
def test_cells_of_different_units_are_asked(
    tmp_path: Path, header: str, formats: list[str], unit: str, notes: list[str]
) -> None:
    write(tmp_path / "a.xlsx", header, formats)
    columns = f'  columns: {{v: "{header}"}}\n' if "(" in header else ""
    with pytest.raises(SpecError) as caught:
        load(tmp_path, "a.xlsx", unit, LAYOUT + columns)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0878"
    assert len(fault.notes) == 2
    assert all(a.startswith(b) for a, b in zip(fault.notes, notes, strict=True)), fault.notes
    # the advice
    key = str(fault.help).split("`")[1]
    data = load(tmp_path, "a.xlsx", unit, f"{LAYOUT}  {key}\n")
    assert data.warnings == ()
    write(tmp_path / "a.xlsx", header, [formats[0]] * len(formats))
    if header == "v":
        assert len(load(tmp_path, "a.xlsx", unit, LAYOUT).series["v"]) == len(formats)


@pytest.mark.parametrize(
    ("header", "formats", "unit", "first"),
    [
        # digits and words for one unit do not differ
        ("v", [PERCENT, "0.00%", "0.0%;-0.0%"], "1", 1.0),
        ("v", [SPEED, '0.00" km/h"', '0 "kph"'], "m/s", 1 / 3.6),
        ("v [km/h]", [SPEED, PLAIN, "0.00"], "m/s", 1 / 3.6),
        ("v [km/h]", [PLAIN, SPEED, PLAIN], "m/s", 1 / 3.6),
        ("v", [PLAIN, "0.00", "#,##0.0"], "m/s", 1.0),
        ("v [%]", [PLAIN, "0.0"], "1", 0.01),
    ],
)
def test_cells_of_one_unit_are_read(
    tmp_path: Path, header: str, formats: list[str], unit: str, first: float
) -> None:
    write(tmp_path / "a.xlsx", header, formats)
    data = load(tmp_path, "a.xlsx", unit, LAYOUT)
    assert data.series["v"][0] == pytest.approx(first, rel=1e-15)
    assert data.warnings == ()


def test_cells_above_the_header_and_empty_ones_do_not_count(tmp_path: Path) -> None:
    write(tmp_path / "a.xlsx", "v", [None, SPEED, None, SPEED], above=3)
    layout = LAYOUT + "  csv: {skip: 3}\n  nan: split\n"
    data = load(tmp_path, "a.xlsx", "m/s", layout)
    assert data.series["v"][1] == pytest.approx(2 / 3.6, rel=1e-15)
    assert data.warnings == ()
