"""`csv: {thousands: "."}` names the sign between groups of three digits."""

from __future__ import annotations

from pathlib import Path

import openpyxl
import pytest

from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.data.specs import load


def values(folder: Path, csv: str, cells: list[str], delimiter: str = ";") -> list[float]:
    """The values of x in a file with these cells."""
    rows = [delimiter.join([str(row), cell, str(-row)]) for row, cell in enumerate(cells)]
    text = "\n".join([delimiter.join(["time", "x", "F"]), *rows]) + "\n"
    section = f"source: {{train: log.csv}}\n{csv and f'csv: {csv}'}\n"
    return load(folder, section, {"log.csv": text}).series["x"].tolist()


def fault_of(folder: Path, csv: str, cells: list[str], delimiter: str = ";") -> Diagnostic:
    with pytest.raises(SpecError) as caught:
        values(folder, csv, cells, delimiter)
    (fault,) = caught.value.diagnostics
    return fault


POINT, BLANK = '{decimal: ",", thousands: "."}', '{decimal: ",", thousands: " "}'


@pytest.mark.parametrize(
    ("csv", "cells", "numbers"),
    [
        (POINT, ["1.234.567,5", "-1.234", "+12.345e-3"], [1234567.5, -1234, 12.345]),
        (POINT, ["1234567,5", "0,5", "999"], [1234567.5, 0.5, 999]),
        ('{thousands: ","}', ["1,234.5", "1234.5", "1,234,567."], [1234.5, 1234.5, 1234567]),
        ('{thousands: "\'"}', ["1'234.5", "1\u2019234.5"], [1234.5, 1234.5]),
        ('{thousands: "\u2019"}', ["1'234.5", "1\u2019234.5"], [1234.5, 1234.5]),
        (
            BLANK,
            ["1 234,5", "1\u00a0234,5", "1\u2009234", "1\u202f234"],
            [1234.5, 1234.5, 1234, 1234],
        ),
        ('{thousands: "\\u202f"}', ["1 234", "1\u00a0234"], [1234, 1234]),
    ],
)
def test_signs_between_groups_of_three_digits_are_no_digits(
    tmp_path: Path, csv: str, cells: list[str], numbers: list[float]
) -> None:
    assert values(tmp_path, csv, cells) == numbers


def test_times_have_signs_of_thousands(tmp_path: Path) -> None:
    section = 'source: {train: log.csv}\ntime: {column: time, unit: ms}\ncsv: {thousands: ","}\n'
    text = "time;x;F\n800;1;0\n1,000;2;0\n1,200;3;0\n"
    assert load(tmp_path, section, {"log.csv": text}).rows == 3


def test_a_mark_of_missing_values_is_compared_after_the_signs(tmp_path: Path) -> None:
    section = f"source: {{train: log.csv}}\ncsv: {POINT}\nmissing: -9999\nnan: split\n"
    data = load(tmp_path, section, {"log.csv": "x;F\n1.000;1\n-9.999;2\n"})
    assert data.usable.tolist() == [True, False]


@pytest.mark.parametrize(
    ("csv", "cell"),
    [
        (POINT, "1.5"),
        (POINT, "0.123"),
        (POINT, "012.345"),
        (POINT, "1234.567"),
        (POINT, "1.2345"),
        (POINT, "1..234"),
        (POINT, "1.234,567.8"),
        (POINT, "1.234.5"),
        ('{thousands: ","}', "1,5"),
        ('{thousands: "\'"}', "12'34"),
        (BLANK, "1 23"),
        (BLANK, "1\u00a0000 00"),
    ],
)
def test_other_groups_are_faults(tmp_path: Path, csv: str, cell: str) -> None:
    fault = fault_of(tmp_path, csv, ["1", cell, "2"])
    assert (fault.code, fault.span and fault.span.line) == ("E0891", 3)
    plain = "".join(sign for sign in cell if sign.isdigit())
    assert values(tmp_path, csv, [plain]) == [float(plain)]


def test_the_advice_about_other_groups_reads_the_file(tmp_path: Path) -> None:
    fault = fault_of(tmp_path, POINT, ["1.5", "2.25"])
    key = str(fault.help).split("`")[3]
    assert values(tmp_path, f"{{{key}}}", ["1.5", "2.25"]) == [1.5, 2.25]


@pytest.mark.parametrize("cell", ["1.5 mm", "a.b"])
def test_a_text_with_a_sign_of_thousands_is_a_text(tmp_path: Path, cell: str) -> None:
    assert fault_of(tmp_path, POINT, [cell]).code == "E0807"


@pytest.mark.parametrize(
    ("csv", "delimiter"),
    [
        ('{thousands: ","}', ","),
        ('{thousands: " "}', " "),
        # blanks of any width separate cells, found by the header
        ('{thousands: "\\u00a0"}', " "),
        ('{delimiter: " ", thousands: "\\u202f"}', " "),
    ],
)
def test_a_delimiter_is_no_sign_of_thousands(tmp_path: Path, csv: str, delimiter: str) -> None:
    fault = fault_of(tmp_path, csv, ["1", "2"], delimiter)
    assert fault.code == "E0890"


@pytest.mark.parametrize(
    ("csv", "cell", "number"),
    [
        ("", "1.234,5", 1234.5),
        ("", "1.234.567", 1234567),
        ("", "-1.234.567,25", -1234567.25),
        ("", "1,234.5", 1234.5),
        ("", "1,234,567", 1234567),
        ("", "1,500", 1500),
        ("", "1'000.5", 1000.5),
        ("", "1 000.5", 1000.5),
        ("", "1\u00a0000,5", 1000.5),
        ('{decimal: ","}', "1.500", 1500),
        ('{decimal: ","}', "1.234.567", 1234567),
        ('{decimal: ","}', "1'000", 1000),
        ('{decimal: ","}', "1\u202f000,5", 1000.5),
    ],
)
@pytest.mark.parametrize("delimiter", [";", "\t", ","])
def test_messages_offer_the_key(
    tmp_path: Path, csv: str, cell: str, number: float, delimiter: str
) -> None:
    cells = [f'"{cell}"' if delimiter == "," else cell]
    csv = csv.replace("{", '{delimiter: "\\t", ') if delimiter == "\t" and csv else csv
    fault = fault_of(tmp_path, csv, cells, delimiter)
    assert fault.code in ("E0807", "E0808")
    keys = [part for part in str(fault.help).split("`") if part.startswith("csv: {")]
    key = next((key for key in keys if "thousands" in key), None)
    if delimiter == "," and cell in ("1,234.5", "1,234,567", "1,500"):
        # the comma separates cells
        assert key is None
        return
    assert key is not None
    assert 'decimal: ","' in key or not csv
    assert values(tmp_path, key.removeprefix("csv: "), cells, delimiter) == [number]


def test_workbooks_have_no_key_for_texts(tmp_path: Path) -> None:
    section = "source: {train: log.xlsx}\n"
    for cell, code in (("1'000.5", "E0807"), ("1,500", "E0808")):
        book = openpyxl.Workbook()
        for row in (["x", "F"], [cell, 1]):
            book.worksheets[0].append(row)
        book.save(tmp_path / "log.xlsx")
        with pytest.raises(SpecError) as caught:
            load(tmp_path, section, {})
        (fault,) = caught.value.diagnostics
        assert (fault.code, "csv:" in str(fault.help)) == (code, False)
        with pytest.raises(SpecError, match="E0876"):
            load(tmp_path, section + 'csv: {thousands: "\'"}\n', {})
