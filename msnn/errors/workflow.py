"""E0950-E0999: sections of the workflow that name things which the model or the data lack."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def unknown_output(name: str, span: Span, outputs: Sequence[str]) -> Diagnostic:
    """E0950: an export of what is neither an output of the model nor an equation."""
    meant = nearest(name, outputs)
    return Diagnostic(
        "E0950",
        "error",
        f"unknown output `{name}`",
        span,
        "neither an output nor an equation",
        notes=(f"outputs: {', '.join(outputs)}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def casadi_is_double(span: Span) -> Diagnostic:
    """E0951: a CasADi function in single precision, which CasADi does not have."""
    return Diagnostic(
        "E0951",
        "error",
        "CasADi computes in float64 only",
        span,
        "`dtype: float32` here",
        help="leave `dtype:` out",
    )


def untimed_library(span: Span) -> Diagnostic:
    """E0956: constant time with functions of a C library, whose time nobody knows."""
    return Diagnostic(
        "E0956",
        "error",
        "functions of a C library do not take constant time",
        span,
        "`constant_time: true` with `math: libm` here",
        help="leave `math:` out: the project's own functions take constant time",
    )


def vast_jacobian(numbers: int, most: int, span: Span | None) -> Diagnostic:
    """E0957: a Jacobian of more entries than a program should carry."""
    return Diagnostic(
        "E0957",
        "error",
        f"a matrix of the Jacobian would have {numbers:,} entries",
        span,
        f"{most:,} at most",
        notes=("every sample in a buffer is a number of the state",),
        help="shorten the windows, or leave `with:` out",
    )


def unknown_signal(name: str, span: Span, signals: Sequence[str]) -> Diagnostic:
    """E0952: a column for a signal that the model does not have."""
    meant = nearest(name, signals)
    return Diagnostic(
        "E0952",
        "error",
        f"a column for `{name}`, which is not a logged signal",
        span,
        "not an input, target or measured state",
        notes=(f"logged signals: {', '.join(signals)}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def unknown_set(name: str, span: Span | None, sets: Iterable[str]) -> Diagnostic:
    """E0953: a set that the section `data` does not make."""
    sets = tuple(sets)
    meant = nearest(name, sets)
    return Diagnostic(
        "E0953",
        "error",
        f"`data:` makes no set `{name}`",
        span,
        "no such set",
        notes=(f"sets: {', '.join(sets)}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def needless_data(name: str, span: Span) -> Diagnostic:
    """E0954: training or metrics of a spec that names no data."""
    return Diagnostic(
        "E0954",
        "error",
        f"`{name}:` needs data, and the spec has no `data:` section",
        span,
        "reads measured data",
        help="the least is `data: {source: {train: data/*.csv}}`",
    )


def records_too_short(longest: int, needed: int) -> Diagnostic:
    """E0955: a simulation of records that are shorter than what one step reads."""
    return Diagnostic(
        "E0955",
        "error",
        f"a simulation needs {needed} rows without a gap, the longest record has {longest}",
        None,
    )
