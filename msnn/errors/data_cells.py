"""E0806 to E0810 and E0822: cells and rows of data that are not what they should be."""

import re

from msnn.errors.data_files import _and_more
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def ragged_row(
    file: str, row: int, found: int, expected: int, more: int, place: Span, *, commas: bool
) -> Diagnostic:
    """E0806: a row with more or fewer cells than the header; `more` rows are like it."""
    return Diagnostic(
        "E0806",
        "error",
        f"row {row} of {file} has {found} cells, the header has {expected} columns",
        place,
        f"{found} cells",
        notes=_and_more(more, "row"),
        help=_COMMA_HELP if commas else None,
    )


def not_a_number(file: str, row: int, column: str, text: str, more: int, place: Span) -> Diagnostic:
    """E0807: text where a number belongs."""
    return Diagnostic(
        "E0807",
        "error",
        f"`{text}` in column `{column}` is not a number (row {row} of {file})",
        place,
        "not a number",
        notes=_and_more(more, "cell"),
        help=_repair_of(text),
    )


def line_of_units(file: str, columns: str, place: Span) -> Diagnostic:
    """E0825: a line of units below the header, where the first row of numbers belongs."""
    return Diagnostic(
        "E0825",
        "error",
        f"row 0 of {file} has units, not numbers",
        place,
        "a line of units",
        help=f"remove the line; where a unit is not the signal's, write `columns: {columns}`",
    )


def decimal_comma(
    file: str, row: int, column: str, text: str, more: int, place: Span, *, delimiter: str
) -> Diagnostic:
    """E0808: a number with a comma where the point belongs."""
    own = "" if delimiter == "," else 'delimiter: ";", '
    return Diagnostic(
        "E0808",
        "error",
        f"`{text}` in column `{column}` has a decimal comma (row {row} of {file})",
        place,
        f"write `{text.replace(',', '.')}`",
        notes=_and_more(more, "cell"),
        help=f'a file with decimal commas needs `csv: {{{own}decimal: ","}}` under `data:`',
    )


def missing_value(
    file: str, row: int, column: str, text: str, more: int, place: Span | None
) -> Diagnostic:
    """E0809: an empty or NaN cell of an input while `nan: error` holds."""
    found = f"`{text}`" if text else "no value"
    return Diagnostic(
        "E0809",
        "error",
        f"column `{column}` has {found} in row {row} of {file}",
        place,
        "an input is missing here",
        notes=_and_more(more, "cell"),
        help="`nan: split` ends the episode here, `nan: drop` leaves the record out",
    )


def infinite_value(
    file: str, row: int, column: str, text: str, more: int, place: Span | None
) -> Diagnostic:
    """E0810: a cell that is infinite."""
    return Diagnostic(
        "E0810",
        "error",
        f"`{text}` in column `{column}` is not finite (row {row} of {file})",
        place,
        "not a finite number",
        notes=_and_more(more, "cell"),
    )


def unbalanced_quote(file: str, row: int, more: int, place: Span) -> Diagnostic:
    """E0822: a quote that its line does not close."""
    return Diagnostic(
        "E0822",
        "error",
        f'row {row} of {file} has a `"` that its line does not close',
        place,
        "opened here",
        notes=_and_more(more, "row"),
    )


def _repair_of(text: str) -> str | None:
    """What to write in place of a text that people often have in a table."""
    if _DATE.match(text):
        return "write the time as a number: seconds since the start of the record"
    if text.upper() in _NOT_MEASURED:
        return "leave the cell empty where nothing was measured"
    joined = _BLANKS.sub("", text)
    if joined != text and _NUMBER.fullmatch(joined):
        return f"write the number without blanks: `{joined}`"
    return None


_DATE = re.compile(r"\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{2,4}|\d{1,2}:\d\d(:\d\d)?")
_NOT_MEASURED = frozenset(
    ["N/A", "#N/A", "NONE", "#NULL!", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NUM!", "-", "--"]
)
_BLANKS = re.compile(r"[\s\u00a0\u2009\u202f]")
_NUMBER = re.compile(r"[+-]?\d+([.]\d*)?([eE][+-]?\d+)?")
_COMMA_HELP = 'a file with decimal commas needs `csv: {delimiter: ";", decimal: ","}`'
