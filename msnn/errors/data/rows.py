"""E0811-E0850, E0875-E0877, E0958, E1131, W0801-W0830: rows of data, times, sets, filters."""

from collections.abc import Iterable, Mapping, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, remark, warning
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit


def time_gap(
    file: str, row: int, step: float, expected: float, more: int, place: Span | None
) -> Diagnostic:
    """E0811: two rows that are not one sample time apart."""
    message = f"the time step to row {row} of {file} is {step:.6g} s, not {expected:.6g} s"
    notes = and_more(more, "gap")
    repair = "`resample: none` makes an episode of each part, `resample: linear` fills short gaps"
    return error("E0811", place, message, "time gap before this row", notes=notes, help=repair)


def wrong_sample_time(
    file: str, found: float, expected: float, place: Span | None, *, repair: str | None
) -> Diagnostic:
    """E0812: a file whose usual step of time is not `sample_time`."""
    # no sample time fits all steps
    usual = "usually " if repair is None else ""
    message = (
        f"the rows of {file} are {usual}{found:.6g} s apart, `sample_time` is {expected:.6g} s"
    )
    label = "not one sample after the row before"
    return error("E0812", place, message, label, help=repair or _TO_NEAREST_ROWS)


_TO_NEAREST_ROWS = (
    "`resample: linear` brings the rows to `sample_time`; a value that predictions are compared "
    "with, and that the model does not read, belongs to the nearest row"
)


def other_sample_time(
    *, file: str, found: float, expected: float, repair: str | None = None, index: str | None = None
) -> Diagnostic:
    """W0811: rows whose step of time is not `sample_time`."""
    message = f"the rows of {file} are {found:.6g} s apart, `sample_time` is {expected:.6g} s"
    if index is not None:  # of a frame
        message += ", and no `time:` names its index"
        repair = f"write `time: {index}` under `data:` to read the times of the index"
    return warning("W0811", None, message, help=repair)


def step_repair(
    found: float,
    expected: float,
    *,
    rows: int,
    every: int,
    column: str | None,
    unit: Unit | None,
) -> str:
    """The repair where rows are `found` seconds apart and `sample_time` says otherwise.

    `rows` of the file, of which the spec takes one in `every`; `column` and `unit` of their times,
    None where the spec names no column or its times are dates.
    """
    ratio = expected / found if found > 0 else 0.0
    picked = round(ratio * every)
    is_whole = round(ratio) > 1 and abs(ratio - round(ratio)) < 0.01 * ratio
    thinned = f"`every: {picked}` takes one row in {picked}"
    leaves_rows = is_whole and rows > picked
    if column is not None and unit is not None:
        likely = (u for u, s in _TIME_UNITS.items() if abs(s / unit.scale / ratio - 1) < 0.01)
        if meant := next(likely, None) if ratio else None:
            repair = f"if the time is in {meant}, write `time: {{column: {column}, unit: {meant}}}`"
            if meant == "d":
                repair += (
                    ", or format serial dates of a spreadsheet as dates: their text is rounded"
                )
            return f"{repair}; else {thinned}" if leaves_rows else repair
    step = f"write `sample_time: {seconds_text(found)}`"
    if is_whole and _is_unit_of_time(ratio):
        return f"{step} if its unit is wrong; else {thinned}" if leaves_rows else step
    return thinned if leaves_rows else f"{step}, or bring the rows to it by `resample:`"


_TIME_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Units that a column of time often has, in seconds."""


def _is_unit_of_time(ratio: float) -> bool:
    """True if two units of time differ by a whole ratio, as s and ms do."""
    pairs = ((a, b) for a in _TIME_UNITS.values() for b in _TIME_UNITS.values())
    return any(abs(a / b / ratio - 1) < 0.01 for a, b in pairs)


def seconds_text(value: float) -> str:
    """A duration in s, below one second in ms."""
    return f"{value:.6g} s" if value >= 1 else f"{value * 1000:.6g} ms"


def time_not_increasing(
    file: str,
    row: int,
    step: float,
    more: int,
    place: Span | None,
    *,
    set_back: bool = False,
    is_stream: bool = False,
    is_picked: bool = False,
) -> Diagnostic:
    """E0813: a time that is not later than the one before."""
    message = f"the time in row {row} of {file} is not later than in the row before"
    notes = and_more(more, "row")
    if set_back:
        message = f"the time in row {row} of {file} goes back by an hour: the end of summer time?"
        # sorted, the rows of two hours would be mixed
        repair = (
            "if the clock was set back, name its zone, as `zone: Europe/Berlin` under `time:`, or "
            "write times with their offset from UTC: `02:50+02:00` and then `02:00+01:00`; "
            "`resample: none` makes an episode of each part"
        )
    elif step == 0.0 and not is_picked:
        repair = (
            "`duplicates: first`, `last` or `mean` under `data:` makes one row of those with the "
            "same time; if the time was rounded, "
        ) + (
            "name another one with `time:`"
            if is_stream
            else "remove `time:`, and rows are one sample apart"
        )
    elif is_stream:
        # nobody edits the rows of such a file
        repair = "name another time with `time:`, or export the signals to a table of one time"
    elif is_picked:
        repair = (
            "give `from` and `to` as numbers of rows, such as `from: 0`, beside `resample: none`; "
            "if rows are out of order, sort them by time"
        )
    else:
        # sorted, the rows of two recordings would be mixed
        repair = (
            "if another recording begins there, `resample: none` makes an episode of each; if rows "
            "are out of order, sort them by time"
        )
    return error("E0813", place, message, "time does not increase", notes=notes, help=repair)


def rows_not_there(
    what: str | None,
    file: str,
    rows: int,
    span: Span | None,
    times: tuple[str, str] | None = None,
) -> Diagnostic:
    """E0818: `from` or `to` outside the file."""
    # of columns with times of their own
    if what is None:
        message = f"the columns of {file} have no time in common"
        repair = "one ends before another begins, or outside of `from` and `to`: choose other times"
        return error("E0818", span, message, "no rows left", help=repair)
    # the first and the last time, where times pick rows
    has = f"rows 0 … {rows - 1}" if times is None else f"times {times[0]} … {times[1]}"
    message = f"{what} leaves no rows of {file}, which has {has if rows else 'none'}"
    repair = "choose `from` and `to` within them, or leave them out" if rows else None
    return error("E0818", span, message, "no rows left", help=repair)


def impossible_split(reason: str, span: Span | None, repair: str | None = None) -> Diagnostic:
    """E0819: a `split:` that cannot be made."""
    return error("E0819", span, reason, "in this split", help=repair)


def no_rows_in_set(name: str, sets: Iterable[str], span: Span | None) -> Diagnostic:
    """E0820: a set without rows that a stage or metric needs."""
    notes = (f"sets with data: {listed(tuple(sets)) or 'none'}",)
    return error("E0820", span, f"no data in the set `{name}`", "this set is empty", notes=notes)


def sets_differ(sets: Sequence[str], span: Span | None) -> Diagnostic:
    """E0958: given data files whose columns are unclear, because the sets of the spec have
    different ones.
    """
    message = (
        f"the sets {listed([f'`{name}`' for name in sets])} lay out their files in different ways"
    )
    repair = f"say like which of them: `--data-set {sets[0]}`, or `data_set=` in Python"
    return error("E0958", span, message, "whose columns do the given files have?", help=repair)


def episodes_too_short(
    name: str, longest: int, needed: int, wanted_by: str, span: Span | None
) -> Diagnostic:
    """E0821: a set in which every episode is shorter than one rollout."""
    message = f"{wanted_by} needs {needed} rows, the longest episode of `{name}` has {longest}"
    repair = "shorten the horizon, or look for gaps in the data"
    if longest >= needed:
        message = f"{wanted_by} finds no row of `{name}` at which its states can start"
        repair = "look for missing values in what their `init:` reads, or give them a number"
        return error("E0821", span, message, "every start reads a missing value", help=repair)
    return error("E0821", span, message, "every episode is too short", help=repair)


def rows_all_skipped(skipped: int, longest: int, wanted_by: str, span: Span | None) -> Diagnostic:
    """E0848: `skip_rows` of a stage or metric that leaves no row of any record."""
    message = (
        f"{wanted_by} skips the first {skipped} rows of each record, the longest has {longest}"
    )
    repair = "make `skip_rows:` shorter than the records"
    return error("E0848", span, message, "nothing is scored", help=repair)


def unfit_factor(loss: str, value: float, place: str, count: int, span: Span | None) -> Diagnostic:
    """E0850: a row factor of a loss that is negative, infinite or missing."""
    found = "missing" if value != value else f"{value:g}"
    more = f" and in {count - 1} rows after it" if count > 1 else ""
    message = f"`rows` of the loss `{loss}` is {found} in {place}{more}"
    repair = "a factor is a number ≥ 0; `rows: where(s > 0, s, 0)` leaves out what is not"
    return error("E0850", span, message, "how much does such a row count?", help=repair)


def no_class(loss: str, value: float, place: str, count: int, span: Span | None) -> Diagnostic:
    """E1131: a label that is not the number of a class of a cross-entropy."""
    more = f", one of {count} such numbers" if count > 1 else ""
    message = f"{value:g} is no class of the loss `{loss}`, in {place}{more}"
    repair = (
        "classes are counted from 0, one for each element of the first argument; "
        "a cell that is empty is not scored"
    )
    return error("E1131", span, message, "of which class is such a row?", help=repair)


def no_time_column(what: str, span: Span | None) -> Diagnostic:
    """E0823: a duration for rows without a time column."""
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
        f"in {listed(files)}"
    )
    return warning("W0802", None, message)


def starts_not_measured(
    *,
    wanted_by: str,
    signals: Sequence[str],
    left_out: int,
    total: int,
    horizon: int,
    better: int | None,
    span: Span | None,
) -> Diagnostic:
    """W0836: rollouts omitted because samples for their initial states are missing."""
    names = " and ".join(f"`{name}`" for name in signals)
    steps = "one step" if horizon == 1 else f"{horizon} steps"
    message = (
        f"{wanted_by} leaves out {left_out} of {total} rollouts of {steps}: {names}, from which "
        "they start, is not measured where they begin"
    )
    repair = "write `rollout: record`, which begins once, at the first measured start of a record"
    if better is not None and better != horizon:
        repair = f"write `rollout: {better}`: it begins where {names} is measured; or `record`"
    return warning("W0836", span, message, help=repair)


def record_dropped(record: str, file: str, row: int) -> Diagnostic:
    """W0803: a recording omitted because an input is missing in it."""
    of = "" if file == record else f" of {file}"
    return warning("W0803", None, f"{record} is left out: an input is missing in row {row}{of}")


def kept_values(
    *, column: str, measured: int, kept: int, lost: int, rows: int, offset: float
) -> Diagnostic:
    """W0830: the number of measured values of a resampled column that are compared with
    predictions.
    """
    message = (
        f"resampling keeps {kept} of {measured} measured values of column `{column}`, "
        f"one in each of {kept} rows of {rows}"
    )
    notes: list[str] = []
    if shared := measured - kept - lost:
        notes.append(f"{shared} are nearest to a row that has one already")
    if lost:
        notes.append(f"{lost} are nearest to a row without inputs, or to none")
    if offset:
        notes.append(f"values are up to {seconds_text(offset)} away from their rows")
    make = warning if lost else remark
    return make("W0830", None, message, notes=tuple(notes))


def unusable_array(column: str, file: str, wanted_by: str, reason: str) -> Diagnostic:
    """E0840: an array of a file that is not a column of numbers."""
    return error("E0840", None, f"`{column}` of {file} cannot feed {wanted_by}: {reason}")


def unequal_columns(file: str, lengths: Mapping[str, int]) -> Diagnostic:
    """E0841: columns of one file that do not have the same number of rows."""
    listed = ", ".join(f"`{name}` has {length}" for name, length in lengths.items())
    message = f"the columns of {file} are not equally long"
    return error("E0841", None, message, notes=(f"rows: {listed}",))


def different_times(file: str, first: str, other: str, span: Span | None) -> Diagnostic:
    """E0842: signals recorded at different times, without a rule to join them."""
    message = f"`{first}` and `{other}` of {file} were recorded at different times"
    repair = "`resample: nearest` or `resample: linear` brings them to the `sample_time`"
    return error("E0842", span, message, "of this data", help=repair)


def no_time_to_resample(file: str, span: Span | None) -> Diagnostic:
    """E0843: `resample:` for rows without times."""
    message = f"the rows of {file} have no time, so they cannot be resampled"
    repair = "name the column of time with `time:`"
    return error("E0843", span, message, "resampling needs the time of each row", help=repair)


def static_resample(span: Span | None) -> Diagnostic:
    """E0844: `resample:` for a model without `sample_time`."""
    message = "`resample:` needs a `sample_time`, and this model is static"
    repair = "declare `sample_time:`, or remove `resample:`"
    return error("E0844", span, message, "to which time step?", help=repair)


def time_of_another_group(
    column: str, file: str, other: str, span: Span | None, *, keeps_time: bool = True
) -> Diagnostic:
    """E0875: a time column that does not belong to the other column."""
    message = f"`{column}` of {file} does not have the times of `{other}`"
    # a file of tables may have no other times
    repair = "name a time that all columns have, as a channel of the same name in each group"
    if keeps_time:
        repair = "name a time that all columns have, or leave `time:` out: the file keeps times"
    return error("E0875", span, message, "recorded by another clock", help=repair)


def unused_key(key: str, reason: str, span: Span | None) -> Diagnostic:
    """E0876: a key of `data:` without any effect on its files."""
    message = f"`{key}` has no effect: {reason}"
    return error("E0876", span, message, "for these files", help=f"remove `{key}`")


def decimal_between_cells(file: str, decimal: str, span: Span | None) -> Diagnostic:
    """E0877: one character for decimals and between cells."""
    message = f"`{decimal}` is the decimal sign of {file} and separates its cells"
    repair = 'name the other one: `csv: {delimiter: ";"}`, or remove `decimal:`'
    return error("E0877", span, message, "cells of this line", help=repair)


def rows_of_streams(key: str, file: str, span: Span | None) -> Diagnostic:
    """E0845: row numbers for a file whose columns have times of their own."""
    message = f"`{key}` counts rows, but the columns of {file} have different rows"
    repair = "give a time, for example `2 s`"
    if key == "every":
        repair = "remove `every:`; `resample: linear` brings all columns to the `sample_time`"
    return error("E0845", span, message, "a number of rows", help=repair)


def wide_filter(span: Span) -> Diagnostic:
    """E0846: a `filter:` that reads other rows than the one that it decides."""
    message = "a filter decides on each row by that row alone"
    return error("E0846", span, message, "reads other samples than those at t")


def not_a_condition(span: Span) -> Diagnostic:
    """E0847: a `filter:` that is not a comparison."""
    message = "a filter is a comparison such as `v > 2`"
    repair = "rows for which the comparison holds are kept"
    return error("E0847", span, message, "not a comparison", help=repair)


def empty_filter(file: str, span: Span | None) -> Diagnostic:
    """W0804: a `filter:` that removes all rows of a file."""
    return warning("W0804", span, f"the filter leaves no row of {file}", "false in every row")


def missing_reader(what: str, install: str, span: Span) -> Diagnostic:
    """W0805: a data format whose reader is not installed."""
    return warning("W0805", span, what, "cannot be read here", help=install)


_LISTED = 12
_LONGEST = 60
"""Characters of a name."""


def listed(names: Sequence[str]) -> str:
    shown = ", ".join(map(shortened, names[:_LISTED]))
    return f"{shown}, … ({len(names)} in all)" if len(names) > _LISTED else shown


def shortened(name: str) -> str:
    """A name of a file as a person can read it: a line without line ends may be megabytes long."""
    return name if len(name) <= _LONGEST else f"{name[:_LONGEST]}… ({len(name):,} characters)"


def and_more(count: int, what: str) -> tuple[str, ...]:
    """A note that counts further faults of one kind."""
    if not count:
        return ()
    return (f"{count} more {what}{'s' if count > 1 else ''} of this kind in the file",)
