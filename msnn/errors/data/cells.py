"""E0508-E0512, E0806-E0822, E0878-E1319, W0511, W0831, W0835: cells, dates and units."""

import re
from collections.abc import Sequence

from msnn.errors.data.rows import and_more
from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
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
    """E0806: a row with more or fewer cells than the header."""
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


def not_a_number(
    file: str,
    row: int,
    column: str,
    text: str,
    more: int,
    place: Span,
    *,
    delimiter: str | None,
    decimal: str,
) -> Diagnostic:
    """E0807: text in a cell that must be a number."""
    message = f"`{text}` in column `{column}` is not a number (row {row} of {file})"
    notes = and_more(more, "cell")
    repair = _repair_of(text, column, delimiter, decimal)
    return error("E0807", place, message, "not a number", notes=notes, help=repair)


def wrong_groups(
    file: str,
    row: int,
    column: str,
    text: str,
    more: int,
    place: Span,
    *,
    thousands: str,
    decimal: str,
) -> Diagnostic:
    """E0891: a cell whose signs of thousands do not part groups of three digits."""
    message = (
        f"`{text}` in column `{column}` is no number whose signs of thousands part groups of three "
        f"digits (row {row} of {file})"
    )
    repair = "write the number without signs of thousands"
    if thousands in ".,":
        key = f'write `decimal: "{thousands}"` and remove `thousands:`'
        repair += f"; if `{thousands}` is the decimal sign of the file, {key}"
    label = f"1234.5 is `1{thousands}234{decimal}5` here"
    return error("E0891", place, message, label, notes=and_more(more, "cell"), help=repair)


def decimal_comma(
    file: str, row: int, column: str, text: str, more: int, place: Span, *, delimiter: str | None
) -> Diagnostic:
    """E0808: a number with a decimal comma instead of a decimal point."""
    message = f"`{text}` in column `{column}` has a decimal comma (row {row} of {file})"
    meant, *others = with_point_or_joined(text)
    label = "write " + " or ".join(f"`{number}`" for number in (meant, *others))
    if delimiter is None:
        repair = f"the cell has a text: write the number {' or '.join((meant, *others))} into it"
        notes = and_more(more, "cell")
        return error("E0808", place, message, label, notes=notes, help=repair)
    repair = f"a file with decimal commas needs `{_csv_key(delimiter, decimal=',')}` under `data:`"
    if others:
        key = "" if delimiter == "," else f", or `{_csv_key(delimiter, thousands=',')}` for all"
        repair = f"where the comma parts thousands write `{meant}`{key}; {repair}"
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
    """E0822: a quote that is not closed in its line."""
    message = f'row {row} of {file} has a `"` that its line does not close'
    return error("E0822", place, message, "opened here", notes=and_more(more, "row"))


def _csv_key(delimiter: str, **signs: str) -> str:
    """The entry `csv:` for a file with these signs; the delimiter unless it is a comma."""
    own = {} if delimiter == "," else {"delimiter": delimiter.replace("\t", "\\t")}
    entries = [f'{key}: "{sign}"' for key, sign in (own | signs).items()]
    return f"csv: {{{', '.join(entries)}}}"


def _repair_of(text: str, column: str, delimiter: str | None, decimal: str) -> str | None:
    """The repair of a text that people often have in a table."""
    if text == column:
        return "remove this line: a second header, as where two logs were joined"
    if text.upper() in _TRUTHS:
        return f"write `{_TRUTHS[text.upper()]}`: 1 for true, 0 for false"
    if (found := _GROUPED.fullmatch(text)) is not None:
        return _repair_of_groups(found, delimiter, decimal)
    if united := _WITH_UNIT.fullmatch(text):
        number, unit = united.groups()
        if unit.rstrip("+-").lower() == "e":
            return f"write the digits of its exponent, as in `{number}e3`"
        return f"write `{number}` and the unit in the header: `{column} [{unit}]`"
    if (plain := _plain_number(text)) is not None:
        return f"write it as `{plain}`"
    if _ISO_DATE.match(text) and read_moment(text) is None:
        return "dates reach from 1823 to 2116: leave rows out whose clock was not set"
    if _DATE.match(text):
        return (
            "write times as `2026-11-22 17:00:00.25` (ISO 8601) or as numbers, or how they are "
            f'written: `time: {{column: {column!r}, format: "{_likely_format(text)}"}}`'
        )
    if text.upper() in _NOT_MEASURED:
        return (
            "leave the cell empty where nothing was measured, "
            f'or write `missing: "{text}"` under `data:`'
        )
    if text.startswith("="):
        return "a formula has no value yet: open the file in a spreadsheet program and save it"
    joined = _SIGNS_BESIDE_POINTS.sub("", text)
    if joined != text and _NUMBER.fullmatch(joined):
        return f"write the number without blanks or apostrophes: `{joined}`"
    return None


def _likely_format(text: str) -> str:
    """The format of a date of a country, or an example."""
    found = _DAY_AND_CLOCK.fullmatch(text)
    if found is None:
        return "%d/%m/%Y %H:%M:%S"
    _, sign, second, year, blank, clock, fraction = found.groups()
    # where both orders are possible, the user sees which one it is
    day = f"%m{sign}%d{sign}" if int(second) > 12 else f"%d{sign}%m{sign}"
    parts = "" if clock is None else blank + ("%H:%M:%S" if clock.count(":") == 2 else "%H:%M")
    digits = "" if fraction is None else f"{fraction}%f"
    return day + ("%Y" if len(year) == 4 else "%y") + parts + digits


def _repair_of_groups(found: re.Match[str], delimiter: str | None, usual: str) -> str:
    """The repair of a number with groups of three digits: without its signs, or by a key."""
    text, sign = found[0], found["sign"]
    digits = text.replace(sign, "")
    # a point or comma between thousands leaves the other one for decimals
    decimal = found["decimal"] or {".": ",", ",": "."}.get(sign, usual)
    plain = digits.replace(decimal, ".")
    if delimiter is None:
        return f"the cell has a text: write the number {plain} into it"
    signs = {} if decimal == "." else {"decimal": decimal}
    signs["thousands"] = " " if sign.isspace() else sign
    key = f"`{_csv_key(delimiter, **signs)}` under `data:`"
    # blanks of any width separate cells where one does
    is_delimiter = sign == delimiter or (delimiter == " " and sign.isspace())
    if sign == "." and text.count(".") == 1 and "," not in text:
        meant = f"`{plain}` or `{text.replace('.', ',')}`"
        return f"beside decimal commas a point may part thousands: write {meant}, or {key} for all"
    return f"write it as `{plain}`" + ("" if is_delimiter else f", or {key}")


def _plain_number(text: str) -> str | None:
    """The number that another notation means: `0x1F`, `1.5D+01`, `−5`."""
    if _HEXADECIMAL.fullmatch(text):
        return str(int(text, 16))
    plain = text.replace("\u2212", "-").replace("D", "E").replace("d", "e")
    return plain if plain != text and _NUMBER.fullmatch(plain) else None


_DAY_AND_CLOCK = re.compile(
    r"(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d\d)(?:( )(\d{1,2}:\d\d(?::\d\d)?)(?:([.,])\d{1,9})?)?"
)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+([.]\d*)?")
_POINTS_AND_COMMA = re.compile(r"[+-]?\d{1,3}(\.\d{3})+,\d*")


_GROUPED = re.compile(
    r"[+-]?[1-9]\d{0,2}(?P<sign>[.,'\u2019 \u00a0\u2009\u202f])\d{3}(?:(?P=sign)\d{3})*"
    r"(?:(?!(?P=sign))(?P<decimal>[.,])\d*)?(?:[eE][+-]?\d+)?",
    re.ASCII,
)
"""A number with groups of three digits, such as `1.234,5` or `1 234 567`."""
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
_SIGNS_BESIDE_POINTS = re.compile(r"[\s\u00a0\u2009\u202f'\u2019]")
_NUMBER = re.compile(r"[+-]?\d+([.]\d*)?([eE][+-]?\d+)?")
_COMMA_HELP = (
    "if its numbers have decimal commas, nothing tells them from separators: save it with `;` "
    'between cells, and write `csv: {delimiter: ";", decimal: ","}`'
)


_OFFSET = re.compile(r"\s*([Zz]|[+-]\d\d(:?\d\d)?)$")


def misfitting_date(
    what: str, date: str, file: str, has_zone: bool | None, span: Span | None
) -> Diagnostic:
    """E0979: a date in the spec for a file whose times are no dates, or are dates of
    another clock.
    """
    if has_zone is None:
        times = f"the times of {file} are seconds"
        repair = "write the time as they are, such as `20 s`"
    elif has_zone:
        times = f"the dates of {file} have an offset from UTC"
        # a day alone has no offset: it is midnight
        repair = f"write `Z` or the offset behind it: `{date if ':' in date else f'{date} 00:00'}Z`"
    else:
        times = f"the dates of {file} have no offset from UTC"
        repair = f"write it as that clock showed it, such as `{_OFFSET.sub('', date)}`"
    message = f"{what} is the date {date}, and {times}"
    return error("E0979", span, message, "not to be compared with them", help=repair)


def not_a_moment(
    file: str, row: int, column: str, text: str, more: int, place: Span | None
) -> Diagnostic:
    """E0989: a text or number in a column of dates."""
    message = f"`{text}` in column `{column}` is no moment such as `2026-11-22 17:00:00.25`"
    notes = (f"row {row} of {file}; the rows before have dates", *and_more(more, "cell"))
    repair = "write every time as ISO 8601, or every time as a number"
    return error("E0989", place, message, "not a date and a time of day", notes=notes, help=repair)


def unlike_format(
    file: str, row: int, column: str, text: str, more: int, place: Span | None, *, wanted: str
) -> Diagnostic:
    """E0887: a time that does not fit `format:`."""
    message = f"`{text}` in column `{column}` does not fit the format `{wanted}`"
    notes = (f"row {row} of {file}", *and_more(more, "cell"))
    repair = "write `format:` as most cells are, and correct or remove rows with other times"
    if read_moment(text) is not None:
        repair = "remove `format:` if all cells are so: ISO 8601 needs none"
    return error("E0887", place, message, "another format, or no date", notes=notes, help=repair)


def other_kind_of_times(
    key: str, column: str, file: str, kind: str, span: Span | None
) -> Diagnostic:
    """E0889: `format:` or `zone:` of a column whose times are of another kind."""
    wanted = "texts of dates" if key == "format" else "dates without an offset from UTC"
    message = f"`{key}:` is of {wanted}, and column `{column}` of {file} has {kind}"
    return error("E0889", span, message, "of other times", help=f"remove `{key}:`")


def no_moment_in_zone(
    *,
    file: str,
    row: int,
    column: str,
    text: str,
    more: int,
    place: Span | None,
    zone: str,
    twice: bool,
    standard: str | None,
) -> Diagnostic:
    """E0888: a local time that its zone skips or has twice when clocks are changed."""
    if twice:
        what = "is there twice: clocks were set back, and the order of rows does not tell which"
        label = "before or after the change?"
        repair = (
            "write these times with their offset from UTC and `%z` in `format:`, or leave them out"
        )
    else:
        what = "is skipped: clocks were set forward"
        label = "no clock of that zone shows it"
        repair = "name the zone of the logger, or leave these rows out"
    if standard is not None:
        repair += f"; if the logger has no summer time, write `zone: {standard}`"
    message = f"the time `{text}` of column `{column}` {what} in {zone}"
    notes = (f"row {row} of {file}", *and_more(more, "cell"))
    return error("E0888", place, message, label, notes=notes, help=repair)


def mixed_zones(
    file: str, row: int, column: str, text: str, more: int, place: Span | None
) -> Diagnostic:
    """E0990: dates with and without a time zone in one column."""
    message = f"`{text}` in column `{column}` and the times before differ in having a time zone"
    notes = (f"row {row} of {file}", *and_more(more, "cell"))
    repair = "write `Z` or an offset such as `+01:00` behind every time, or behind none"
    return error("E0990", place, message, "is it the same clock?", notes=notes, help=repair)


def units_differ(
    *, file: str, signal: str, column: str, named: str, stated: str, place: Span | None
) -> Diagnostic:
    """E0991: a header that names another unit than the file states below it or apart."""
    message = f"{file} states two units of column `{column}`: {named} and {stated}"
    key = _key_with_unit(signal, column, stated)
    return error(
        "E0991", place, message, "which one is right?", help=f"write the true one: `{key}`"
    )


def doubtful_capitals(
    *, signal: str, column: str, text: str, readings: tuple[str, ...], span: Span | None
) -> Diagnostic:
    """E0512: a unit in capital letters with several readings that fit the signal."""
    first, *others = readings
    message = f"the file has `{column}` in `{text}`, which may be {' or '.join(readings)}"
    rest = " or ".join(f"`unit: {unit}`" for unit in others)
    repair = f"write the true one: `{_key_with_unit(signal, column, first)}`, or {rest}"
    notes = ("the file does not show whether it tells small from capital letters",)
    return error("E0512", span, message, "which one is right?", notes=notes, help=repair)


def mixed_cells(
    *,
    file: str,
    signal: str,
    column: str,
    cells: Sequence[tuple[str | None, str, int]],
    declared: str,
    span: Span | None,
) -> Diagnostic:
    """E0878: a column of a workbook whose number formats show different units."""
    message = f"the cells of column `{column}` in {file} are shown in different units"
    notes = tuple(
        f"{'no unit' if unit is None else unit}: cell {cell}"
        + (f" and {count - 1} more" if count > 1 else "")
        for unit, cell, count in cells
    )
    unit = next((unit for unit, _, _ in cells if unit is not None), declared)
    key = _key_with_unit(signal, column, unit)
    repair = f"give all its cells one number format, or write the unit of all: `{key}`"
    return error("E0878", span, message, "in which unit is it?", notes=notes, help=repair)


def unit_beside_scale(
    *, signal: str, column: str, found: str, declared: str, span: Span | None
) -> Diagnostic:
    """E0997: a factor in the spec for a column whose file states another unit than that of the
    signal.
    """
    message = (
        f"the file has `{column}` in {found}, `{signal}` is in {declared}, and the spec has a "
        "`scale:` or `offset:` for it"
    )
    repair = f"write `unit: {declared}` beside `scale:` if that converts, else take `scale:` away"
    return error("E0997", span, message, "does this convert the unit?", help=repair)


def scaled_twice(signal: str, column: str, scaling: str, span: Span | None) -> Diagnostic:
    """W0835: a column that both its file and the spec scale."""
    message = (
        f"the file scales `{column}` by its {scaling}, and the spec has a `scale:` or `offset:` "
        f"for `{signal}` as well: both apply"
    )
    repair = "remove `scale:` and `offset:` if they repeat those of the file"
    return warning("W0835", span, message, "is this the factor of the file?", help=repair)


def unit_of_moments(column: str, unit: str, span: Span | None) -> Diagnostic:
    """E0998: a unit of time for a column whose times are dates."""
    message = f"column `{column}` has dates, and `unit: {unit}` is said of it"
    return error("E0998", span, message, "dates have no unit", help="remove `unit:`")


def misfitting_file_unit(
    *,
    signal: str,
    column: str,
    found: str,
    declared: str,
    meant: str | None,
    span: Span | None,
) -> Diagnostic:
    """E0999: a column whose unit, by the file's own words, does not convert to the signal's."""
    message = f"the file has `{column}` in {found}, which does not convert to {declared}"
    if meant is not None:
        repair = f"if it means {meant}, write `{_key_with_unit(signal, column, meant)}`"
    else:
        key = _key_with_unit(signal, column, declared)
        repair = f"if the numbers are in {declared}, write `{key}`"
        if signal != "time":
            repair = f"declare `{signal}` in the unit of the column, {found}; {repair}"
    return error("E0999", span, message, f"`{signal}` is in {declared}", help=repair)


def turns_of_column(
    *,
    signal: str,
    column: str,
    found: str,
    declared: str,
    readings: tuple[str, str, str],
    span: Span | None,
) -> Diagnostic:
    """E0508: a conversion between a count per time, such as 1/min, and an angle per time, such as
    rad/s.
    """
    count, turns, radians = readings
    message = (
        f"column `{column}` is in {found} and signal `{signal}` in {declared}: {count} may count "
        "revolutions or radians"
    )
    if count == found:
        key = _key_with_unit(signal, column, turns)
        repair = f"write `{key}` for revolutions, or `unit: {radians}` for radians"
    else:
        repair = f"declare `{signal}` in `{turns}` for revolutions, or in `{radians}` for radians"
    label = f"`{signal}` is in {declared}"
    return error("E0508", span, message, label, help=repair)


def unread_unit(
    *,
    signal: str,
    column: str,
    text: str,
    declared: str,
    meant: str | None,
    scale: float,
    span: Span | None,
) -> Diagnostic:
    """W0511: a unit in a data file that msnn does not know."""
    message = (
        f"the file has `{column}` in `{text}`, which is no known unit: its numbers are taken as "
        f"{declared}"
    )
    said = meant or declared
    if scale != 1.0 and signal != "time":
        said = f"{said}, scale: {scale:g}"
    repair = f"write the unit of the column: `{_key_with_unit(signal, column, said)}`"
    return warning("W0511", span, message, f"`{signal}` is in {declared}", help=repair)


def too_far_a_moment(file: str, row: int, column: str, text: str, more: int) -> Diagnostic:
    """E1319: a date too far from 1970."""
    message = f"`{text}` in column `{column}` is no date between 1823 and 2116"
    notes = (f"row {row} of {file}", *and_more(more, "cell"))
    repair = "leave rows out whose clock was not set, or whose date stands for none"
    return error("E1319", None, message, notes=notes, help=repair)


def _key_with_unit(signal: str, column: str, unit: str) -> str:
    """The key of `data:` that says in which unit a signal's column is."""
    said = f"{{column: {column!r}, unit: {unit}}}"
    return f"time: {said}" if signal == "time" else f"columns: {{{signal}: {said}}}"


def unit_without_effect(signal: str, unit: str, span: Span | None) -> Diagnostic:
    """W0831: the unit of a column that feeds a signal without a declared unit."""
    message = (
        f"the column of `{signal}` is in {unit}, and `{signal}` declares no unit to convert to"
    )
    repair = f"declare it: `{signal}: {{unit: {unit}}}`, or remove `unit:` here"
    return warning("W0831", span, message, "converts nothing", help=repair)
