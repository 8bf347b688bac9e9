"""E0950-E0999, W0955: sections of the workflow that do not fit the model or the data."""

from collections.abc import Iterable, Mapping, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest
from spec_schema.yaml_tree.writer import scalar_text

_AT_A_KINK = {
    "sign": "`sign` jumps",
    "sqrt": "the slope of `sqrt` is infinite, as its argument can be 0,",
    "where": "`where` can jump, or its slope,",
}
"""What happens there, where it is not the slope alone that jumps."""


def unknown_output(name: str, span: Span, outputs: Sequence[str]) -> Diagnostic:
    """E0950: an export of what is neither an output of the model nor an equation."""
    meant = nearest(name, outputs)
    message = f"unknown output `{name}`"
    label = "neither an output nor an equation"
    notes = (f"outputs: {', '.join(outputs)}",)
    repair = did_you_mean(meant)
    return error("E0950", span, message, label, notes=notes, help=repair, replacement=meant)


def casadi_is_double(span: Span) -> Diagnostic:
    """E0951: a CasADi function in single precision, which CasADi does not have."""
    message = "CasADi computes in float64 only"
    return error("E0951", span, message, "`dtype: float32` here", help="leave `dtype:` out")


def kink_within_ranges(
    word: str,
    declared: Mapping[str, tuple[float, float]],
    span: Span,
    *,
    stays: bool,
) -> Diagnostic:
    """W0955: a kink inside the declared ranges of what is exported for solvers."""
    ranges = " and ".join(f"`{n}` in [{low:g}, {high:g}]" for n, (low, high) in declared.items())
    message = _AT_A_KINK.get(word, f"the slope of `{word}` jumps") + " inside the declared ranges"
    repairs = "`smooth: true` below `casadi:` rounds it off; `smooth: false` says that the solver"
    repair = f"{repairs} takes it as it is"
    if stays:
        message = f"`smooth: true` leaves a kink of `{word}` inside the declared ranges"
        repair = "a branch of it is not finite everywhere: write it so that it is"
    return warning(
        "W0955",
        span,
        message,
        "solvers that take second derivatives can get stuck here",
        notes=(f"reached with {ranges}",),
        help=repair,
    )


def untimed_library(span: Span) -> Diagnostic:
    """E0956: constant time with functions of a C library, whose time nobody knows."""
    message = "functions of a C library do not take constant time"
    label = "`constant_time: true` with `math: libm` here"
    repair = "leave `math:` out: the project's own functions take constant time"
    return error("E0956", span, message, label, help=repair)


def vast_jacobian(numbers: int, most: int, span: Span | None) -> Diagnostic:
    """E0957: a Jacobian of more entries than a program should carry."""
    message = f"a matrix of the Jacobian would have {numbers:,} entries"
    notes = ("every sample in a buffer is a number of the state",)
    repair = "shorten the windows, or leave `with:` out"
    return error("E0957", span, message, f"{most:,} at most", notes=notes, help=repair)


def unknown_signal(
    name: str, span: Span, signals: Sequence[str], column: str | None = None
) -> Diagnostic:
    """E0952: a column for a signal that the model does not have."""
    meant = nearest(name, signals)
    message = f"a column for `{name}`, which is not a logged signal"
    label = "not an input, target or measured state"
    notes = (f"logged signals: {', '.join(signals)}",)
    repair = did_you_mean(meant)
    if column in signals:
        repair = (
            "the signal stands on the left, its column on the right: "
            f"`columns: {{{column}: {scalar_text(name, in_flow=True)}}}`"
        )
        meant = None
    return error("E0952", span, message, label, notes=notes, help=repair, replacement=meant)


def unknown_set(name: str, span: Span | None, sets: Iterable[str]) -> Diagnostic:
    """E0953: a set that the section `data` does not make."""
    sets = tuple(sets)
    meant = nearest(name, sets)
    message = f"`data:` makes no set `{name}`"
    notes = (f"sets: {', '.join(sets)}",)
    repair = did_you_mean(meant)
    if name == "train" and meant is None:
        repair = "training reads the set `train`: call a source so, or make it with `split:`"
    return error("E0953", span, message, "no such set", notes=notes, help=repair, replacement=meant)


def needless_data(name: str, span: Span) -> Diagnostic:
    """E0954: training or metrics of a spec that names no data."""
    message = f"`{name}:` needs data, and the spec has no `data:` section"
    repair = "the least is `data: {source: {train: data/*.csv}}`"
    return error("E0954", span, message, "reads measured data", help=repair)


def records_too_short(longest: int, needed: int) -> Diagnostic:
    """E0955: a simulation of records that are shorter than what one step reads."""
    message = f"a simulation needs {needed} rows without a gap, the longest record has {longest}"
    return error("E0955", None, message)
