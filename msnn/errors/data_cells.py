"""E0806 to E0810 and E0822: cells and rows of data that are not what they should be."""

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
    )


def decimal_comma(
    file: str, row: int, column: str, text: str, more: int, place: Span
) -> Diagnostic:
    """E0808: a number with a comma where the point belongs."""
    return Diagnostic(
        "E0808",
        "error",
        f"`{text}` in column `{column}` has a decimal comma (row {row} of {file})",
        place,
        f"write `{text.replace(',', '.')}`",
        notes=_and_more(more, "cell"),
        help=_COMMA_HELP,
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


_COMMA_HELP = 'a file with decimal commas needs `csv: {delimiter: ";", decimal: ","}`'
