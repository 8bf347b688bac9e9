"""E0806 to E0810 and E0822: cells and rows of data that are not what they should be."""

import re

from msnn.errors.data.lists import and_more
from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import with_point_or_joined
from spec_schema.expressions.moments import read_moment


def ragged_row(
    file: str,
    row: int,
    found: int,
    expected: int,
    more: int,
    place: Span,
    *,
    commas: bool,
    ends_empty: bool = False,
) -> Diagnostic:
    """E0806: a row with more or fewer cells than the header; `more` rows are like it."""
    message = f"row {row} of {file} has {found} cells, the header has {expected} columns"
    notes = and_more(more, "row")
    if commas:
        repair = _COMMA_HELP
    elif ends_empty:
        repair = "put the separator behind the header too: the rows end with one"
    elif found < expected:
        repair = "write a cell for each column, empty where there is no value, or remove the line"
    else:
        repair = 'put a cell that holds the separator in quotes, `"…"`, or remove what is too much'
    return error("E0806", place, message, f"{found} cells", notes=notes, help=repair)


def not_a_number(file: str, row: int, column: str, text: str, more: int, place: Span) -> Diagnostic:
    """E0807: text where a number belongs."""
    message = f"`{text}` in column `{column}` is not a number (row {row} of {file})"
    notes = and_more(more, "cell")
    return error(
        "E0807", place, message, "not a number", notes=notes, help=_repair_of(text, column)
    )


def decimal_comma(
    file: str, row: int, column: str, text: str, more: int, place: Span, *, delimiter: str
) -> Diagnostic:
    """E0808: a number with a comma where the point belongs."""
    own = "" if delimiter == "," else 'delimiter: ";", '
    message = f"`{text}` in column `{column}` has a decimal comma (row {row} of {file})"
    meant, *others = with_point_or_joined(text)
    label = "write " + " or ".join(f"`{number}`" for number in (meant, *others))
    repair = f'a file with decimal commas needs `csv: {{{own}decimal: ","}}` under `data:`'
    if others:
        repair = f"where the comma parts thousands write `{meant}`; {repair}"
    return error("E0808", place, message, label, notes=and_more(more, "cell"), help=repair)


def missing_value(
    file: str,
    row: int,
    column: str,
    text: str,
    more: int,
    place: Span | None,
    *,
    is_time: bool = False,
    is_all: bool = False,
    is_slow: bool = False,
) -> Diagnostic:
    """E0809: an empty or NaN cell of an input while `nan: error` holds, or of a time."""
    found = f"`{text}`" if text else "no value"
    message = f"column `{column}` has {found} in row {row} of {file}"
    notes = and_more(more, "cell")
    repair = "`nan: split` ends the episode here, `nan: drop` leaves the record out"
    label = "an input is missing here"
    if is_all:
        message = f"column `{column}` of {file} has no value at all"
        notes = ()
        repair = f"name another column for what reads `{column}`, under `data:`"
    elif is_slow:
        repair = (
            "the column has values at even steps: `resample: linear`, or `nearest`, takes it "
            "between them; else " + repair
        )
    elif is_time:
        repair = "write the time, or remove the row; if rows are one step apart, remove `time:`"
        label = "every row needs its time"
    return error("E0809", place, message, label, notes=notes, help=repair)


def infinite_value(
    file: str, row: int, column: str, text: str, more: int, place: Span | None
) -> Diagnostic:
    """E0810: a cell that is infinite."""
    message = f"`{text}` in column `{column}` is not finite (row {row} of {file})"
    repair = "write the number that it was, or leave the cell empty where nothing was measured"
    notes = and_more(more, "cell")
    return error("E0810", place, message, "not a finite number", notes=notes, help=repair)


def unbalanced_quote(file: str, row: int, more: int, place: Span) -> Diagnostic:
    """E0822: a quote that its line does not close."""
    message = f'row {row} of {file} has a `"` that its line does not close'
    return error("E0822", place, message, "opened here", notes=and_more(more, "row"))


def _repair_of(text: str, column: str) -> str | None:
    """The repair of a text that people often have in a table."""
    if text == column:
        return "remove this line: a second header, as where two logs were joined"
    if text.upper() in _TRUTHS:
        return f"write `{_TRUTHS[text.upper()]}`: 1 for true, 0 for false"
    if (thousands := text.replace("'", "")) != text and _NUMBER.fullmatch(thousands):
        return f"write the number without apostrophes: `{thousands}`"
    if united := _WITH_UNIT.fullmatch(text):
        number, unit = united.groups()
        if unit.rstrip("+-").lower() == "e":
            return f"write the digits of its exponent, as in `{number}e3`"
        return f"write `{number}` and the unit in the header: `{column} [{unit}]`"
    if (plain := _plain_number(text)) is not None:
        return f"write it as `{plain}`"
    if _POINTS_AND_COMMA.fullmatch(text):
        whole = text.replace(".", "")
        point = whole.replace(",", ".")
        return f'write it as `{point}`, or as `{whole}` with `csv: {{decimal: ","}}` under `data:`'
    if _ISO_DATE.match(text) and read_moment(text) is None:
        return "dates reach from 1823 to 2116: leave rows out whose clock was not set"
    if _DATE.match(text):
        return "write times as `2026-11-22 17:00:00.25` (ISO 8601), or as numbers"
    if text.upper() in _NOT_MEASURED:
        return "leave the cell empty where nothing was measured"
    if text.startswith("="):
        return "a formula has no value yet: open the file in a spreadsheet program and save it"
    if _NUMBER.fullmatch(text):
        whole, point = text.replace(".", ""), text.replace(".", ",", 1)
        return f"beside decimal commas a point may part thousands: write `{whole}` or `{point}`"
    joined = _BLANKS.sub("", text)
    if joined != text and _NUMBER.fullmatch(joined):
        return f"write the number without blanks: `{joined}`"
    return None


def _plain_number(text: str) -> str | None:
    """The number that another notation means: `1,234.5`, `0x1F`, `1.5D+01`, `−5`."""
    if _THOUSANDS.fullmatch(text):
        return text.replace(",", "")
    if _HEXADECIMAL.fullmatch(text):
        return str(int(text, 16))
    plain = text.replace("\u2212", "-").replace("D", "E").replace("d", "e")
    return plain if plain != text and _NUMBER.fullmatch(plain) else None


_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+([.]\d*)?")
_POINTS_AND_COMMA = re.compile(r"[+-]?\d{1,3}(\.\d{3})+,\d*")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]{1,16}")
_ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d")
_DATE = re.compile(
    r"\d{4}[-/.]\d\d?[-/.]\d\d?(?!\d)|\d{1,2}[./]\d{1,2}[./]\d{2,4}|\d{1,2}:\d\d(:\d\d)?"
)
_NOT_MEASURED = frozenset(
    ["N/A", "#N/A", "NONE", "#NULL!", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NUM!", "-", "--"]
)
_TRUTHS = {"TRUE": "1", "ON": "1", "YES": "1", "FALSE": "0", "OFF": "0", "NO": "0"}
_WITH_UNIT = re.compile(r"([+-]?\d+(?:[.]\d*)?(?:[eE][+-]?\d+)?)\s*([A-Za-zµμΩ°%][^\s\d]*)")
_BLANKS = re.compile(r"[\s\u00a0\u2009\u202f]")
_NUMBER = re.compile(r"[+-]?\d+([.]\d*)?([eE][+-]?\d+)?")
_COMMA_HELP = (
    "if its numbers have decimal commas, nothing tells them from separators: save it with `;` "
    'between cells, and write `csv: {delimiter: ";", decimal: ","}`'
)
