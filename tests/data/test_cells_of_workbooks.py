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


def write(
    path: Path,
    header: str,
    formats: Sequence[str | None],
    above: int = 0,
    values: Sequence[float] | None = None,
) -> None:
    """A sheet whose cell in row i has the number i + 1 or values[i] in a format; None leaves the
    cell empty."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for _ in range(above):
        sheet.append([1.0, 2.0])
        sheet.cell(sheet.max_row, 2).number_format = '0 "kg"'
    sheet.append(["time", header])
    for row, format in enumerate(formats):
        value = row + 1.0 if values is None else values[row]
        sheet.append([0.1 * row, None if format is None else value])
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


@pytest.mark.parametrize(
    ("header", "format", "unit", "expected"),
    [
        # the cell 12000 is shown as 12.0 kN: it is in N
        ("v", '0.0, "kN"', "N", [12000.0, 10.0]),
        ("v", '#,##0.0,\\ "kN"', "kN", [12.0, 0.01]),
        ("v", '0.000,,"MN"', "N", [12000.0, 10.0]),
        ("v", '0,.0" kN"', "N", [12000.0, 10.0]),
        ("v", '0.0,"kN*m"', "N*m", [12000.0, 10.0]),
        ("v", '[>=1000]0.0," kg";0.0" g"', "g", [12000.0, 10.0]),
        # commas between digits are not shown as thousands
        ("v", '#,##0.0 "kN"', "kN", [12000.0, 10.0]),
        # the header is that of the shown numbers, or of the cells
        ("v [kN]", '0.0, "kN"', "N", [12000.0, 10.0]),
        ("v [N]", '0.0, "kN"', "N", [12000.0, 10.0]),
        ("v", '0.0, "KN"', "N", [12000.0, 10.0]),
    ],
)
def test_commas_behind_the_digits_show_thousandths_of_cells(
    tmp_path: Path, header: str, format: str, unit: str, expected: list[float]
) -> None:
    write(tmp_path / "a.xlsx", header, [format] * 2, values=[12000.0, 10.0])
    data = load(tmp_path, "a.xlsx", unit, LAYOUT)
    assert data.series["v"].tolist() == pytest.approx(expected, rel=1e-15)
    assert data.warnings == ()


@pytest.mark.parametrize(("header", "unit"), [("v [kN]", "N"), ("v [MN]", "kN")])
def test_commas_below_a_header_with_a_unit_are_asked(
    tmp_path: Path, header: str, unit: str
) -> None:
    write(tmp_path / "a.xlsx", header, ["0.0,"] * 2)
    with pytest.raises(SpecError, match="E0991") as caught:
        load(tmp_path, "a.xlsx", unit, LAYOUT)
    # the advice
    key = str(caught.value.diagnostics[0].help).split("`")[1]
    data = load(tmp_path, "a.xlsx", unit, f"{LAYOUT}  {key}\n")
    assert data.series["v"][0] == 1.0


@pytest.mark.parametrize("format", ['0.0," °C"', '0.0,"min"', '0.0,"apples"'])
def test_a_unit_of_thousandths_that_has_no_name_is_a_warning(tmp_path: Path, format: str) -> None:
    write(tmp_path / "a.xlsx", "v", [format] * 2)
    data = load(tmp_path, "a.xlsx", "s" if "min" in format else "K", LAYOUT)
    assert [warning.code for warning in data.warnings] == ["W0511"]
    assert data.series["v"][0] == 1.0


@pytest.mark.parametrize(
    ("format", "unit", "values", "expected"),
    [
        # escaped and plain letters, as well as quoted ones
        (r"0.0\ \°\C", "K", [20.0], [293.15]),
        (r"0.0\ °C", "K", [20.0], [293.15]),
        (r"0.0\ \N", "kN", [20.0], [0.02]),
        ('General" km/h"', "m/s", [36.0], [10.0]),
        ('"v = "0.0 "km/h"', "m/s", [36.0], [10.0]),
        # signs, blanks and dashes are no units
        ('(0.0 "km/h")', "m/s", [36.0], [10.0]),
        ('0.0 "km/h";-0.0 "km/h";"-"', "m/s", [36.0, 0.0, -36.0], [10.0, 0.0, -10.0]),
        ('0.0 "km/h";-0.0;0', "m/s", [36.0, 0.0, -36.0], [10.0, 0.0, -10.0]),
        ("# ?/?", "m/s", [36.0], [36.0]),
        ("_-* 0.00_-;-* 0.00_-", "m/s", [36.0], [36.0]),
        # the section that shows the number
        ('0.0 "km/h";-0.0 "m/s"', "m/s", [36.0, 0.0], [10.0, 0.0]),
        ('0.0 "km/h";-0.0 "m/s"', "m/s", [-36.0], [-36.0]),
        ('[>100]0.0 "m/s";0.0 "km/h"', "m/s", [36.0, 100.0], [10.0, 100 / 3.6]),
        ('[>100]0.0 "m/s";0.0 "km/h"', "m/s", [101.0], [101.0]),
        ('0 "m";-0 "mm";0 "km"', "m", [0.0], [0.0]),
        ('0 "m";-0 "mm";0 "km"', "m", [-5.0], [-0.005]),
    ],
)
def test_the_section_that_shows_a_number_states_its_unit(
    tmp_path: Path, format: str, unit: str, values: list[float], expected: list[float]
) -> None:
    write(tmp_path / "a.xlsx", "v", [format] * len(values), values=values)
    data = load(tmp_path, "a.xlsx", unit, LAYOUT)
    assert data.series["v"].tolist() == pytest.approx(expected, rel=1e-15)
    assert data.warnings == ()


@pytest.mark.parametrize(
    ("format", "values"),
    [
        ('0.0 "km/h";-0.0 "m/s"', [36.0, -36.0]),
        ('[>100]0.0 "m/s";0.0 "km/h"', [36.0, 101.0]),
        ('[<=1]0.0 "m/s";[>100]0 "km/h";0.0 "mm/s"', [1.0, 50.0]),
    ],
)
def test_sections_of_different_units_are_asked_where_both_show_numbers(
    tmp_path: Path, format: str, values: list[float]
) -> None:
    write(tmp_path / "a.xlsx", "v", [format] * len(values), values=values)
    with pytest.raises(SpecError, match="E0878"):
        load(tmp_path, "a.xlsx", "m/s", LAYOUT)


@pytest.mark.parametrize(
    ("format", "unit", "expected"),
    [
        ("0.0 km/h", "m/s", 10.0),
        (r"0.0\ km/h", "m/s", 10.0),
        (r"0.0\ k\m/h", "m/s", 10.0),
        ("#,##0.00 m/s", "m/s", 36.0),
        ("0 min", "s", 2160.0),
        ("0.00E+00 mS", "S", 0.036),
        ("??0.0 d", "h", 864.0),
        ("General mm", "m", 0.036),
        ("Standard mm", "m", 0.036),
        ("m: 0.0 mm", "m", 0.036),
        ("[$-407]0.0 km/h", "m/s", 10.0),
        ("[$-407]#,##0.0 \\m\\m", "m", 0.036),
        ("[Red][>1]0.0 km/h;0.0 km/h", "m/s", 10.0),
        ("0.0 mbar;[Red]-0.0 mbar", "Pa", 3600.0),
        ("_-* 0.0 ms_-", "s", 0.036),
        (r"0.0 \"mm\"", "1", 36.0),
        # of dates in quotes, escapes and brackets nothing is left
        ('0.0 "yyyy"', "1", 36.0),
    ],
)
def test_letters_of_units_beside_digits_are_no_dates(
    tmp_path: Path, format: str, unit: str, expected: float
) -> None:
    write(tmp_path / "a.xlsx", "v", [format] * 2, values=[36.0, 36.0])
    data = load(tmp_path, "a.xlsx", unit, LAYOUT)
    assert data.series["v"].tolist() == pytest.approx([expected] * 2, rel=1e-15)


@pytest.mark.parametrize(
    "format",
    [
        "yyyy-mm-dd hh:mm:ss",
        "yyyy-mm-dd hh:mm:ss.000",
        r"yyyy\-mm\-dd\Thh:mm:ss\.000",
        "dd/mm/yyyy hh:mm:ss,0",
        "[$-407]d. mmmm yyyy h:mm:ss.00;@",
        'yyyy"-"mm"-"dd hh:mm:ss.0 "UTC"',
        "[Red]m/d/yy h:mm:ss.0 AM/PM",
        "d-mmm-yy",
    ],
)
def test_dates_of_workbooks_stay_dates(tmp_path: Path, format: str) -> None:
    """Zeros behind the seconds are no digits of a number."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["time", "v"])
    for row in range(3):
        sheet.append([46348.5 + row * 0.1 / 86400, row])
        sheet.cell(sheet.max_row, 1).number_format = format
    book.save(tmp_path / "a.xlsx")
    data = load(tmp_path, "a.xlsx", "1", LAYOUT)
    (piece,) = data.records[0].pieces
    assert piece.time is not None
    assert piece.time.tolist() == pytest.approx([0.0, 0.1, 0.2], abs=1e-9)
    assert piece.time_unit is None


def test_a_time_is_in_the_unit_that_its_cells_show(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["time", "v"])
    for row in range(3):
        sheet.append([100.0 * row, row])
        sheet.cell(sheet.max_row, 1).number_format = "0.0 ms"
    book.save(tmp_path / "a.xlsx")
    assert load(tmp_path, "a.xlsx", "1", LAYOUT).rows == 3


def test_cells_above_the_header_and_empty_ones_do_not_count(tmp_path: Path) -> None:
    write(tmp_path / "a.xlsx", "v", [None, SPEED, None, SPEED], above=3)
    layout = LAYOUT + "  csv: {skip: 3}\n  nan: split\n"
    data = load(tmp_path, "a.xlsx", "m/s", layout)
    assert data.series["v"][1] == pytest.approx(2 / 3.6, rel=1e-15)
    assert data.warnings == ()
