"""E0801-E0826, E0869, E0932, E1228, E1326, W0832-W0834, W0837-W0839, W0957: data files."""

import errno
import math
import os
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msnn.errors.data.rows import listed, seconds_text, shortened
from spec_schema.diagnostics.diagnostic import Diagnostic, error, remark, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest
from spec_schema.yaml_tree.writer import scalar_text


def no_file(
    pattern: str, folder: str | None, span: Span | None, meant: str | None = None
) -> Diagnostic:
    """E0801: a file name or pattern that matches no file."""
    relative = "paths are relative to the spec file; `--data-root` moves them" if folder else None
    inside = f" in {folder}" if folder else ""
    message = f"no data file matches `{pattern}`{inside}"
    return error("E0801", span, message, "no such file", help=did_you_mean(meant) or relative)


def unreadable_file(
    file: str, reason: str, repair: str | None = None, place: Span | None = None
) -> Diagnostic:
    """E0802: a file that cannot be read, or that is not text."""
    return error("E0802", place, f"cannot read {file}: {reason}", "from here on", help=repair)


_LONGEST_REASON = 200
"""Maximum number of characters of a library's error message."""


def reason_of(error: Exception, path: Path) -> str:
    """Why a library cannot read a file; its own words come last, without the file's path."""
    if isinstance(error, MemoryError):
        return "it does not fit into memory"
    # libraries do not check what they read, and raise anything for damaged files
    known = (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EISDIR)
    if isinstance(error, OSError) and error.errno in known:
        return os.strerror(error.errno)
    lines = str(error).replace(str(path), path.name).splitlines() or [""]
    text = lines[0][:_LONGEST_REASON].rstrip(". ")
    # a number or a name alone says nothing
    if isinstance(error, KeyError | IndexError | struct.error) or not text:
        text = f"{type(error).__name__} {text}".rstrip()
    return f"it is damaged, or no file of the format that its name says (the reader: {text})"


def no_reader(suffix: str, file: str, fault: Diagnostic) -> Diagnostic:
    """E0932: a file whose suffix no format and no plug-in has, and that is no table of text."""
    message = (
        f"no format of msnn and no installed plug-in reads `{suffix}` files; "
        f"{file} was taken as CSV text: {fault.message}"
    )
    repair = f"install the plug-in that reads `{suffix}` files (`msnn doctor` lists the installed)"
    as_text = f", or, if it is text: {fault.help}" if fault.help else ", or save the file as CSV"
    return replace(fault, code="E0932", message=message, help=repair + as_text, replacement=None)


def read_as_text(suffix: str) -> Diagnostic:
    """W0957: files whose suffix no format and no plug-in has, which are read as text."""
    message = f"no format of msnn and no installed plug-in reads `{suffix}` files"
    repair = "install the plug-in that reads them, or, if they are text, name them `….csv`"
    return warning("W0957", None, f"{message}: they are read as CSV text", help=repair)


def spreadsheet(file: str) -> Diagnostic:
    """E0826: a spreadsheet file where a text file is required."""
    message = f"{file} is a workbook of a spreadsheet, not a table of text"
    repair = "give a workbook of Excel the name `….xlsx`, or save the sheet as CSV and name that"
    return error("E0826", None, message, help=repair)


def empty_file(file: str, *, header: bool) -> Diagnostic:
    """E0803: a file without data rows."""
    what = "has a header but no data rows" if header else "is empty"
    return error("E0803", _start(file), f"{file} {what}", "nothing to read")


def no_column_read(file: str, model: str) -> Diagnostic:
    """E1326: data of a model that reads none of their columns, so that the number of steps is
    unknown.
    """
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
    width: int = 0,
) -> Diagnostic:
    """E0804: columns that the header of a file lacks."""
    # `width` is the number of columns of a table without header
    if len(missing) == 1:
        ((name, wanted_by),) = missing.items()
        message, label = f"{file} has no column `{name}` for {wanted_by}", f"no `{name}` here"
    else:
        message = f"{file} has no columns {listed([f'`{name}`' for name in missing])}"
        label = "none of them here"
    # nobody writes a longer name into a spec
    short = [column for column in columns if shortened(column) == column]
    nearby = {name: meant for name in missing if (meant := _meant(name, short))}
    repair = f"say which column it is: {_named(nearby, missing)} under `data:`" if nearby else None
    if numbers:
        label = "numbers, not names of columns"
        repair = "add a header, or write `csv: {header: false}` and name columns by index, from 0"
    elif tuple(columns[: len(_SIMULATED)]) == _SIMULATED:
        repair = (
            "this is a table that `msnn simulate` has written, no record: move it to where no "
            "`source:` under `data:` takes it, and write the next one there by `--out`"
        )
    elif (swapped := _swapped(missing, columns)) is not None:
        repair = "the signal stands on the left, its column on the right"
        repair = f"if the two are exchanged, write `{swapped}`: {repair}"
    elif repair is None and (member := _member(missing)) is not None:
        own = member.rpartition(".")[2]
        repair = f"name its column: `columns: {{{member}: {own if own in columns else 'NAME'}}}`"
        repair += " under `data:`, or feed it by `connect:`"
    elif repair is None:
        key = key_of_column(next(iter(missing.values())), "0" if width else "NAME")
        repair = f"say which column it is: `{key}` under `data:`"
    notes = (f"columns: {listed(columns)}",)
    if width:
        notes = (f"it has no header: its columns are 0 … {width - 1}",)
    return error("E0804", place, message, label, notes=notes, help=repair)


def _member(missing: Mapping[str, str]) -> str | None:
    """A missing column that has the name of its signal, which is one of a submodel."""
    names = (name for name, user in missing.items() if "." in name and user.strip("`") == name)
    return next(names, None)


def _swapped(missing: Mapping[str, str], columns: Sequence[str]) -> str | None:
    """The key with signal and column exchanged, if the file has a column like the signal."""
    for name, user in missing.items():
        signal = user.strip("`")
        if signal != name and signal in columns and signal != _TIME:
            return f"columns: {{{_quoted(name)}: {_quoted(signal)}}}"
    return None


def _named(nearby: Mapping[str, str], wanted_by: Mapping[str, str]) -> str:
    """The keys that name the columns of signals, and that of the time."""
    signals = {wanted_by[name].strip("`"): meant for name, meant in nearby.items()}
    time = [_quoted(signals.pop(name)) for name in list(signals) if name == _TIME]
    joined = ", ".join(f"{name}: {_quoted(meant)}" for name, meant in signals.items())
    keys = [f"`columns: {{{joined}}}`"] if joined else []
    return " and ".join([*keys, *(f"`time: {column}`" for column in time)])


def key_of_column(wanted_by: str, column: str) -> str:
    """The key under `data:` that names a column of the signal, or of the time, in backticks."""
    name = wanted_by.strip("`")
    return f"time: {column}" if name == _TIME else f"columns: {{{name}: {column}}}"


_SIMULATED = ("file", "set", "row")
"""The columns with which a table of simulations begins (`simulation_rows`)."""
_TIME = "time"
"""What a column of time is wanted by."""


def _meant(name: str, columns: Sequence[str]) -> str | None:
    """The column that a name most likely means: `F [N]`, `force`, `Force`, a typing error, and
    `log.v.data` by `log.v`."""
    plain = {
        # `# time`, as numpy begins a header
        _UNIT_OF_HEADER.sub("", column).lstrip("#%").strip().casefold(): column
        for column in columns
    }
    if name.casefold() in plain:
        return plain[name.casefold()]
    # the array of a struct, beside its unit and its times
    parts = [c for c in columns if f".{name}." in f".{c}" and c.rpartition(".")[2] not in _BESIDE]
    if len(parts) == 1:
        return parts[0]
    if (near := nearest(name, columns)) is not None:
        return near
    longer = [column for key, column in plain.items() if key.startswith(name.casefold())]
    return longer[0] if len(longer) == 1 else None


_BESIDE = frozenset(["unit", "units", "Unit", "Units", "time", "Time", "name", "Name"])
"""Fields of structs that have no values of the signal."""
_UNIT_OF_HEADER = re.compile(r"\s*[\[(].*[\])]\s*$")


def _quoted(column: str) -> str:
    # `10` would be an index, `true` a switch
    is_name = re.fullmatch(r"\w+", column) and scalar_text(column) == column
    return column if is_name else f'"{column}"'


def wrong_delimiter(file: str, used: str, meant: str, place: Span) -> Diagnostic:
    """E0805: a header that another delimiter splits into columns."""
    message = f"{file} is not separated by {_shown(used)}: its header is one column"
    repair = f"write `delimiter: {_written(meant)}` in `csv:` under `data:`"
    return error("E0805", place, message, f"this line has {_shown(meant)}", help=repair)


def late_header(file: str, line: int, place: Span) -> Diagnostic:
    """E1228: a header below other lines, such as information about the logger."""
    message = f"the header of {file} is its line {line}: it stands below other lines"
    repair = f"write `csv: {{skip: {line - 1}}}` under `data:`"
    return error("E1228", place, message, "names of the columns", help=repair)


def duplicate_column(
    name: str,
    file: str,
    place: Span | None,
    repair: str,
) -> Diagnostic:
    """E0814: a required column whose name is in the header twice."""
    message = f"{file} has two columns `{name}`"
    return error("E0814", place, message, "which one is meant is not clear", help=repair)


def no_such_index(index: int, file: str, count: int, wanted_by: str, place: Span) -> Diagnostic:
    """E0815: a column index beyond the columns of a file."""
    message = f"{file} has no column {index} for {wanted_by}: its {count} columns count from 0"
    return error("E0815", place, message, f"{count} columns")


def inconvertible_column(
    signal: str, found: str, declared: str, meant: str | None, span: Span | None
) -> Diagnostic:
    """E0816: a column's unit that does not convert to the signal's."""
    message = f"the column of `{signal}` is in {found}, which does not convert to {declared}"
    repair = f"write `unit: {meant or declared}` if the column is in {meant or declared}"
    if meant is None:
        repair += f", or declare `{signal}` in {found}"
    label = f"`{signal}` is declared in {declared}"
    return error("E0816", span, message, label, help=repair)


def wrong_column_count(signal: str, found: int, expected: int, span: Span | None) -> Diagnostic:
    """E0817: a vector signal with more or fewer columns than elements."""
    message = f"`{signal}` has {expected} elements but {found} columns"
    return error("E0817", span, message, f"{found} columns")


def _start(file: str) -> Span:
    return Span(file=file, line=1, column=1, end_line=1, end_column=1)


def _shown(delimiter: str) -> str:
    return {"\t": "tabs", " ": "spaces"}.get(delimiter, f"`{delimiter}`")


def _written(delimiter: str) -> str:
    return {"\t": '"\\t"'}.get(delimiter, f'"{delimiter}"')


def not_joined(
    *,
    before: str,
    after: str,
    seconds: float,
    columns_differ: bool,
    files: int,
    recordings: int,
    only_gaps: bool,
    span: Span | None,
) -> Diagnostic:
    """W0832: `join: true` that does not make one recording of all files."""
    if math.isnan(seconds):
        reason = f"the times of {after} and {before} cannot be compared"
    elif columns_differ:
        reason = f"the columns of {after} and {before} differ in their units or in what there is"
    elif seconds == 0:
        reason = f"{after} begins with the time at which {before} ends"
    elif seconds > 0:
        reason = f"{after} begins {seconds_text(seconds)} after the end of {before}"
    else:
        reason = f"{after} begins {seconds_text(-seconds)} before the end of {before}"
    joined = "no files" if files == recordings else f"{files} files to {recordings} recordings"
    message = f"`join: true` joins {joined}: {reason}"
    repair = (
        "a file is joined to the one that it follows by one sample; `join: false` says that each "
        "is a recording of its own"
    )
    # recordings with pauses between them, each of several files, are what loggers write
    make = remark if only_gaps and recordings < files else warning
    return make("W0832", span, message, help=repair)


def set_without_rows(
    name: str, covered: str | None, span: Span, *, before: float = 0.0, after: float = 0.0
) -> Diagnostic:
    """W0833: a set that a split names without rows, or without rows in a part of its range."""
    # seconds of its range outside of the data: none of a set without any row
    sides = ((before, "before"), (after, "after"))
    if outside := [f"{seconds_text(gap)} {side}" for gap, side in sides if gap]:
        message = (
            f"`split: {name}` asks for {' and '.join(outside)} the data, which are from {covered}"
        )
        repair = "choose times within the data if the set should be as long as its range"
        # a range may reach beyond the data on purpose, so that the last row is in it
        return remark("W0833", span, message, "partly outside of the data", help=repair)
    message = f"`split: {name}` has no rows" + (f": the data are from {covered}" if covered else "")
    repair = "make its share larger" if covered is None else "choose a time within the data"
    return warning("W0833", span, message, "no row of the data", help=repair)


def rows_in_two_sets(
    *, file: str, sets: tuple[str, str], rows: int, span: Span | None
) -> Diagnostic:
    """W0834: rows of one file that belong to two sets."""
    one, other = sets
    message = f"{file} is in the sets `{one}` and `{other}`: {rows} of its rows are in both"
    repair = "`split:` divides one set; `to:` of one and `from:` of the other part the rows"
    return warning("W0834", span, message, "the same rows again", help=repair)


def not_on_disk(
    reason: str, span: Span | None, repair: str | None = None, why: tuple[str, ...] = ()
) -> Diagnostic:
    """E0869: an operation that is not supported for data on disk."""
    usual = "leave `keep: disk` out where the data fit into memory, else leave that out"
    message = f"`keep: disk` does not go with this: {reason}"
    return error("E0869", span, message, notes=why, help=repair or usual)


def lost_messages(file: str, dropouts: Sequence[float], longest_at: float) -> Diagnostic:
    """W0837: parts of a recording that the logger lost."""
    count = "1 dropout" if len(dropouts) == 1 else f"{len(dropouts)} dropouts"
    message = f"the logger of {file} lost messages: {count}, {seconds_text(sum(dropouts))} in total"
    longest = f"the longest is {seconds_text(max(dropouts))}, at {seconds_text(longest_at)}"
    repair = "with `resample: linear` an episode ends at each hole of the data"
    return warning("W0837", None, message, notes=(longest,), help=repair)


def unread_part(file: str, reason: str) -> Diagnostic:
    """W0838: a file of which only a part is read."""
    return warning("W0838", None, f"a part of {file} is not read: {reason}")


def start_in_doubt(file: str, first: float, last: float) -> Diagnostic:
    """W0839: a recording whose start time cannot be that of its messages."""
    message = (
        f"the times of {file}, counted from its start time, are {first:.6g} s … {last:.6g} s: one "
        "of them is damaged, or the start is of another clock"
    )
    repair = (
        "`from` and `to` in seconds, and ranges of `split:`, count from that start: give times "
        "within these, or copy the file again"
    )
    return warning("W0839", None, message, help=repair)
