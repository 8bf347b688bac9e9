"""E08xx, E1326, W0811: data files, their columns, rows, times and splits."""

import re
from collections.abc import Iterable, Mapping, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest

_LISTED = 12


def no_file(
    pattern: str, folder: str | None, span: Span | None, meant: str | None = None
) -> Diagnostic:
    """E0801: a file name or pattern that nothing matches."""
    relative = "paths are relative to the spec file; `--data-root` moves them" if folder else None
    inside = f" in {folder}" if folder else ""
    message = f"no data file matches `{pattern}`{inside}"
    return error("E0801", span, message, "no such file", help=did_you_mean(meant) or relative)


def unreadable_file(file: str, reason: str) -> Diagnostic:
    """E0802: a file that the system does not give, or that is not text."""
    return error("E0802", None, f"cannot read {file}: {reason}")


def spreadsheet(file: str, span: Span | None = None) -> Diagnostic:
    """E0826: a workbook of a spreadsheet program where a table of text belongs."""
    message = f"{file} is a workbook of a spreadsheet, not a table of text"
    repair = "give a workbook of Excel the name `….xlsx`, or save the sheet as CSV and name that"
    return error("E0826", span, message, help=repair)


def empty_file(file: str, *, header: bool) -> Diagnostic:
    """E0803: a file without data rows."""
    what = "has a header but no data rows" if header else "is empty"
    return error("E0803", _start(file), f"{file} {what}", "nothing to read")


def no_column_read(file: str, model: str) -> Diagnostic:
    """E1326: data of a model that reads none of their columns: it has no number of steps."""
    message = f"`{model}` reads no column, so that {file} does not say how many steps it has"
    repair = "`msnn.stepper` steps a model without data"
    return error("E1326", None, message, help=repair)


def missing_columns(
    missing: Mapping[str, str],
    file: str,
    columns: Sequence[str],
    place: Span | None,
    *,
    numbers: bool,
) -> Diagnostic:
    """E0804: columns that the header of a file does not have; `missing` says what each is for."""
    if len(missing) == 1:
        ((name, wanted_by),) = missing.items()
        message, label = f"{file} has no column `{name}` for {wanted_by}", f"no `{name}` here"
    else:
        message = f"{file} has no columns {_listed([f'`{name}`' for name in missing])}"
        label = "none of them here"
    nearby = {name: meant for name in missing if (meant := _meant(name, columns))}
    repair = f"say which column it is: {_named(nearby, missing)} under `data:`" if nearby else None
    if numbers:
        label = "numbers, not names of columns"
        repair = "add a header, or write `csv: {header: false}` and name columns by index, from 0"
    elif repair is None and (member := next((n for n in missing if "." in n), None)) is not None:
        own = member.rpartition(".")[2]
        repair = f"name its column: `columns: {{{member}: {own if own in columns else 'NAME'}}}`"
        repair += " under `data:`, or feed it by `connect:`"
    notes = (f"columns: {_listed(columns)}",)
    return error("E0804", place, message, label, notes=notes, help=repair)


def _named(nearby: Mapping[str, str], wanted_by: Mapping[str, str]) -> str:
    """The keys that name the columns of signals, and that of the time."""
    signals = {wanted_by[name].strip("`"): meant for name, meant in nearby.items()}
    time = [_quoted(signals.pop(name)) for name in list(signals) if name == _TIME]
    joined = ", ".join(f"{name}: {_quoted(meant)}" for name, meant in signals.items())
    keys = [f"`columns: {{{joined}}}`"] if joined else []
    return " and ".join([*keys, *(f"`time: {column}`" for column in time)])


_TIME = "time"
"""What a column of time is wanted by."""


def _meant(name: str, columns: Sequence[str]) -> str | None:
    """The column that a name most likely means: `F [N]`, `force`, `Force`, a typing error."""
    plain = {_UNIT_OF_HEADER.sub("", column).strip().casefold(): column for column in columns}
    if name.casefold() in plain:
        return plain[name.casefold()]
    if (near := nearest(name, columns)) is not None:
        return near
    longer = [column for key, column in plain.items() if key.startswith(name.casefold())]
    return longer[0] if len(longer) == 1 else None


_UNIT_OF_HEADER = re.compile(r"\s*[\[(].*[\])]\s*$")


def _quoted(column: str) -> str:
    return column if re.fullmatch(r"\w+", column) else f'"{column}"'


def wrong_delimiter(file: str, used: str, meant: str, place: Span) -> Diagnostic:
    """E0805: a header that another delimiter splits into columns."""
    message = f"{file} is not separated by {_shown(used)}: its header is one column"
    repair = f"write `csv: {{delimiter: {_written(meant)}}}` under `data:`"
    return error("E0805", place, message, f"this line has {_shown(meant)}", help=repair)


def time_gap(
    file: str, row: int, step: float, expected: float, more: int, place: Span | None
) -> Diagnostic:
    """E0811: two rows that are not one sample time apart."""
    message = f"the time step to row {row} of {file} is {step:.6g} s, not {expected:.6g} s"
    notes = _and_more(more, "gap")
    repair = "`resample: none` makes an episode of each part, `resample: linear` fills short gaps"
    return error("E0811", place, message, "time gap before this row", notes=notes, help=repair)


def wrong_sample_time(file: str, found: float, expected: float, place: Span | None) -> Diagnostic:
    """E0812: a file whose rows are all spaced otherwise than `sample_time`."""
    message = f"the rows of {file} are {found:.6g} s apart, `sample_time` is {expected:.6g} s"
    return error("E0812", place, message, "the second row", help=_repair_of_step(found, expected))


def other_sample_time(*, file: str, found: float, expected: float) -> Diagnostic:
    """W0811: rows that are spaced otherwise than `sample_time`."""
    message = f"the rows of {file} are {found:.6g} s apart, `sample_time` is {expected:.6g} s"
    return warning("W0811", None, message, help=_repair_of_step(found, expected))


def _repair_of_step(found: float, expected: float) -> str:
    """What to write where rows are `found` seconds apart and `sample_time` says otherwise."""
    ratio = expected / found if found > 0 else 0.0
    if abs(ratio / _DAY - 1) < 0.01:
        return (
            "the time seems to count days, as serial dates of a spreadsheet do, which text rounds: "
            "format the cells as dates with times"
        )
    every = round(ratio)
    if every > 1 and abs(ratio - every) < 0.01 * every:
        return f"`every: {every}` takes one row in {every}"
    if unit := next((u for u, f in _TIME_UNITS.items() if abs(ratio * f - 1) < 0.01), None):
        return f"if the time is in {unit}, write `time: {{column: …, unit: {unit}}}`"
    return f"write `sample_time: {_seconds(found)}`, or bring the rows to it by `resample:`"


_TIME_UNITS = {"ms": 1e3, "us": 1e6, "min": 1 / 60, "h": 1 / 3600}
"""Units that a column of time often has, and how many of them a second is."""


_DAY = 86400.0


def _seconds(value: float) -> str:
    return f"{value:.6g} s" if value >= 1 else f"{value * 1000:.6g} ms"


def time_not_increasing(file: str, row: int, more: int, place: Span | None) -> Diagnostic:
    """E0813: a time that is not later than the one before."""
    message = f"the time in row {row} of {file} is not later than in the row before"
    notes = _and_more(more, "row")
    repair = "sort the rows by time, and of rows with the same time keep one"
    return error("E0813", place, message, "time does not increase", notes=notes, help=repair)


def duplicate_column(
    name: str,
    file: str,
    place: Span | None,
    repair: str = "choose one by its index, counted from 0",
) -> Diagnostic:
    """E0814: a column that is wanted and stands twice in the header."""
    message = f"{file} has two columns `{name}`"
    return error("E0814", place, message, "which one is meant is not clear", help=repair)


def no_such_index(index: int, file: str, count: int, wanted_by: str, place: Span) -> Diagnostic:
    """E0815: a column index beyond the columns of a file."""
    message = f"{file} has no column {index} for {wanted_by}: its {count} columns count from 0"
    return error("E0815", place, message, f"{count} columns")


def inconvertible_column(signal: str, found: str, declared: str, span: Span | None) -> Diagnostic:
    """E0816: a column's unit that does not convert to the signal's."""
    message = f"the column of `{signal}` is in {found}, which does not convert to {declared}"
    return error("E0816", span, message, f"`{signal}` is declared in {declared}")


def wrong_column_count(signal: str, found: int, expected: int, span: Span | None) -> Diagnostic:
    """E0817: a vector signal with more or fewer columns than elements."""
    message = f"`{signal}` has {expected} elements but {found} columns"
    return error("E0817", span, message, f"{found} columns")


def rows_not_there(what: str, file: str, rows: int, span: Span | None) -> Diagnostic:
    """E0818: `from` or `to` that a file does not reach."""
    message = f"{what} leaves no rows of {file}, which has rows 0 … {rows - 1}"
    return error("E0818", span, message, "no rows left")


def impossible_split(reason: str, span: Span | None) -> Diagnostic:
    """E0819: a `split:` that cannot be made."""
    return error("E0819", span, reason, "in this split")


def no_rows_in_set(name: str, sets: Iterable[str], span: Span | None) -> Diagnostic:
    """E0820: a set that a stage or a metric wants and that has no rows."""
    notes = (f"sets with data: {_listed(tuple(sets)) or 'none'}",)
    return error("E0820", span, f"no data in the set `{name}`", "this set is empty", notes=notes)


def sets_differ(sets: Sequence[str], span: Span | None) -> Diagnostic:
    """E0958: other files than those of the spec, whose sets lay theirs out in different ways."""
    message = (
        f"the sets {_listed([f'`{name}`' for name in sets])} lay out their files in different ways"
    )
    repair = f"say like which of them: `--data-set {sets[0]}`, or `data_set=` in Python"
    return error("E0958", span, message, "whose columns do the given files have?", help=repair)


def episodes_too_short(
    name: str, longest: int, needed: int, wanted_by: str, span: Span | None
) -> Diagnostic:
    """E0821: no episode of a set holds one rollout."""
    message = f"{wanted_by} needs {needed} rows, the longest episode of `{name}` has {longest}"
    repair = "shorten the horizon, or look for gaps in the data"
    return error("E0821", span, message, "every episode is too short", help=repair)


def rows_all_skipped(skipped: int, longest: int, wanted_by: str, span: Span | None) -> Diagnostic:
    """E0848: `skip_rows` of a stage or metric that leaves no row of any record."""
    message = (
        f"{wanted_by} skips the first {skipped} rows of each record, the longest has {longest}"
    )
    repair = "make `skip_rows:` shorter than the records"
    return error("E0848", span, message, "nothing is scored", help=repair)


def unfit_factor(loss: str, value: float, place: str, count: int, span: Span | None) -> Diagnostic:
    """E0850: the factor of a row of a loss that is negative, infinite or missing."""
    found = "missing" if value != value else f"{value:g}"
    more = f" and in {count - 1} rows after it" if count > 1 else ""
    message = f"`rows` of the loss `{loss}` is {found} in {place}{more}"
    repair = "a factor is a number ≥ 0; `rows: where(s > 0, s, 0)` leaves out what is not"
    return error("E0850", span, message, "how much does such a row count?", help=repair)


def no_time_column(what: str, span: Span | None) -> Diagnostic:
    """E0823: a duration where no time column gives rows a time."""
    message = f"{what} is a time, but the data has no time column"
    repair = "name the column with `time:`, or give a row number"
    return error("E0823", span, message, "counted in rows without `time:`", help=repair)


def outside_range(
    *, signal: str, count: int, worst: float, low: float, high: float, unit: str, place: str
) -> Diagnostic:
    """W0801: data beyond the range that the spec declares."""
    message = (
        f"{count} samples of `{signal}` are outside its range {low:g} … {high:g}{unit}, "
        f"the farthest is {worst:.6g} in {place}"
    )
    return warning("W0801", None, message)


def episodes_skipped(
    count: int, total: int, needed: int, wanted_by: str, files: Sequence[str]
) -> Diagnostic:
    """W0802: episodes that are too short to be used."""
    message = (
        f"{wanted_by} skips {count} of {total} episodes with fewer than {needed} rows: "
        f"in {_listed(files)}"
    )
    return warning("W0802", None, message)


def record_dropped(file: str, row: int) -> Diagnostic:
    """W0803: a record left out because an input is missing in it."""
    return warning("W0803", None, f"{file} is left out: an input is missing in row {row}")


def _start(file: str) -> Span:
    return Span(file=file, line=1, column=1, end_line=1, end_column=1)


def _shown(delimiter: str) -> str:
    return {"\t": "tabs", " ": "spaces"}.get(delimiter, f"`{delimiter}`")


def _written(delimiter: str) -> str:
    return {"\t": '"\\t"'}.get(delimiter, f'"{delimiter}"')


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_LISTED])
    return f"{shown}, … ({len(names)} in all)" if len(names) > _LISTED else shown


def _and_more(count: int, what: str) -> tuple[str, ...]:
    """A note that counts further faults of one kind."""
    if not count:
        return ()
    return (f"{count} more {what}{'s' if count > 1 else ''} of this kind in the file",)
