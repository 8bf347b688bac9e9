"""E084x: data that is not text: arrays of files, streams with times of their own, filters."""

from collections.abc import Mapping

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def unusable_array(column: str, file: str, wanted_by: str, reason: str) -> Diagnostic:
    """E0840: an array of a file that is not a column of numbers."""
    return Diagnostic(
        "E0840", "error", f"`{column}` of {file} cannot feed {wanted_by}: {reason}", None
    )


def unequal_columns(file: str, lengths: Mapping[str, int]) -> Diagnostic:
    """E0841: columns of one file that do not have the same number of rows."""
    listed = ", ".join(f"`{name}` has {length}" for name, length in lengths.items())
    return Diagnostic(
        "E0841",
        "error",
        f"the columns of {file} are not equally long",
        None,
        notes=(f"rows: {listed}",),
    )


def different_times(file: str, first: str, other: str, span: Span | None) -> Diagnostic:
    """E0842: signals that were recorded at different moments, and nothing says how to join them."""
    return Diagnostic(
        "E0842",
        "error",
        f"`{first}` and `{other}` of {file} were recorded at different times",
        span,
        "of this data",
        help="`resample: nearest` or `resample: linear` brings them to the `sample_time`",
    )


def no_time_to_resample(file: str, span: Span | None) -> Diagnostic:
    """E0843: `resample:` where rows have no time."""
    return Diagnostic(
        "E0843",
        "error",
        f"the rows of {file} have no time, so they cannot be resampled",
        span,
        "resampling needs the time of each row",
        help="name the column of time with `time:`",
    )


def static_resample(span: Span | None) -> Diagnostic:
    """E0844: `resample:` for a model without `sample_time`."""
    return Diagnostic(
        "E0844",
        "error",
        "`resample:` needs a `sample_time`, and this model is static",
        span,
        "to which time step?",
        help="declare `sample_time:`, or remove `resample:`",
    )


def rows_of_streams(key: str, file: str, span: Span | None) -> Diagnostic:
    """E0845: rows counted in a file whose columns have times of their own."""
    return Diagnostic(
        "E0845",
        "error",
        f"`{key}` counts rows, but the columns of {file} have different rows",
        span,
        "a number of rows",
        help="give a time, for example `2 s`",
    )


def wide_filter(span: Span) -> Diagnostic:
    """E0846: a filter that reads other rows than the one that it decides on."""
    return Diagnostic(
        "E0846",
        "error",
        "a filter decides on each row by that row alone",
        span,
        "reads other samples than those at t",
    )


def not_a_condition(span: Span) -> Diagnostic:
    """E0847: a filter that is no comparison."""
    return Diagnostic(
        "E0847",
        "error",
        "a filter is a comparison such as `v > 2`",
        span,
        "not a comparison",
        help="rows for which the comparison holds are kept",
    )


def empty_filter(file: str, span: Span | None) -> Diagnostic:
    """W0804: a filter that leaves nothing of a file."""
    return Diagnostic(
        "W0804", "warning", f"the filter leaves no row of {file}", span, "false in every row"
    )


def missing_reader(what: str, install: str, span: Span) -> Diagnostic:
    """W0805: data in a format whose reader is not installed here."""
    return Diagnostic("W0805", "warning", what, span, "cannot be read here", help=install)
