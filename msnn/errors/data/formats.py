"""E084x, E0875-E0877: data that is not text: arrays, streams with times of their own, filters."""

from collections.abc import Mapping

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def unusable_array(column: str, file: str, wanted_by: str, reason: str) -> Diagnostic:
    """E0840: an array of a file that is not a column of numbers."""
    return error("E0840", None, f"`{column}` of {file} cannot feed {wanted_by}: {reason}")


def unequal_columns(file: str, lengths: Mapping[str, int]) -> Diagnostic:
    """E0841: columns of one file that do not have the same number of rows."""
    listed = ", ".join(f"`{name}` has {length}" for name, length in lengths.items())
    message = f"the columns of {file} are not equally long"
    return error("E0841", None, message, notes=(f"rows: {listed}",))


def different_times(file: str, first: str, other: str, span: Span | None) -> Diagnostic:
    """E0842: signals that were recorded at different moments, and nothing says how to join them."""
    message = f"`{first}` and `{other}` of {file} were recorded at different times"
    repair = "`resample: nearest` or `resample: linear` brings them to the `sample_time`"
    return error("E0842", span, message, "of this data", help=repair)


def no_time_to_resample(file: str, span: Span | None) -> Diagnostic:
    """E0843: `resample:` where rows have no time."""
    message = f"the rows of {file} have no time, so they cannot be resampled"
    repair = "name the column of time with `time:`"
    return error("E0843", span, message, "resampling needs the time of each row", help=repair)


def static_resample(span: Span | None) -> Diagnostic:
    """E0844: `resample:` for a model without `sample_time`."""
    message = "`resample:` needs a `sample_time`, and this model is static"
    repair = "declare `sample_time:`, or remove `resample:`"
    return error("E0844", span, message, "to which time step?", help=repair)


def time_of_another_group(column: str, file: str, other: str, span: Span | None) -> Diagnostic:
    """E0875: a column of time that says nothing of when another column was recorded."""
    message = f"`{column}` of {file} does not have the times of `{other}`"
    repair = "name a time that all columns have, or leave `time:` out: the file keeps times itself"
    return error("E0875", span, message, "recorded by another clock", help=repair)


def unused_key(key: str, reason: str, span: Span | None) -> Diagnostic:
    """E0876: a key of `data:` that changes nothing about its files."""
    message = f"`{key}` has no effect: {reason}"
    return error("E0876", span, message, "for these files", help=f"remove `{key}`")


def decimal_between_cells(file: str, decimal: str, span: Span | None) -> Diagnostic:
    """E0877: a decimal sign that separates the cells of a file as well."""
    message = f"`{decimal}` is the decimal sign of {file} and separates its cells"
    repair = 'name the other one: `csv: {delimiter: ";"}`, or remove `decimal:`'
    return error("E0877", span, message, "cells of this line", help=repair)


def rows_of_streams(key: str, file: str, span: Span | None) -> Diagnostic:
    """E0845: rows counted in a file whose columns have times of their own."""
    message = f"`{key}` counts rows, but the columns of {file} have different rows"
    repair = "give a time, for example `2 s`"
    if key == "every":
        repair = "remove `every:`; `resample: linear` brings all columns to the `sample_time`"
    return error("E0845", span, message, "a number of rows", help=repair)


def wide_filter(span: Span) -> Diagnostic:
    """E0846: a filter that reads other rows than the one that it decides on."""
    message = "a filter decides on each row by that row alone"
    return error("E0846", span, message, "reads other samples than those at t")


def not_a_condition(span: Span) -> Diagnostic:
    """E0847: a filter that is no comparison."""
    message = "a filter is a comparison such as `v > 2`"
    repair = "rows for which the comparison holds are kept"
    return error("E0847", span, message, "not a comparison", help=repair)


def empty_filter(file: str, span: Span | None) -> Diagnostic:
    """W0804: a filter that leaves nothing of a file."""
    return warning("W0804", span, f"the filter leaves no row of {file}", "false in every row")


def missing_reader(what: str, install: str, span: Span) -> Diagnostic:
    """W0805: data in a format whose reader is not installed here."""
    return warning("W0805", span, what, "cannot be read here", help=install)
