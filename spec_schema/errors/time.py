"""E06xx: time, samples and windows."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def not_a_multiple(
    duration: str, sample_time: str, below: str, above: str, span: Span
) -> Diagnostic:
    """E0601: a duration between two samples."""
    return Diagnostic(
        "E0601",
        "error",
        f"{duration} is not a multiple of the sample time {sample_time}",
        span,
        "falls between two samples",
        help=f"write {below} or {above}",
    )


def needs_sample_time(what: str, span: Span) -> Diagnostic:
    """E0602: time in a static model."""
    return Diagnostic(
        "E0602",
        "error",
        f"{what} needs a `sample_time:`",
        span,
        "a model without sample time has independent rows",
        help="add for example `sample_time: 10 ms`",
    )


def empty_window(span: Span) -> Diagnostic:
    """E0603: a window that ends before it begins."""
    return Diagnostic(
        "E0603",
        "error",
        "the window ends before it begins",
        span,
        "empty window",
        notes=("both ends are inclusive, the oldest sample comes first: `x[t-4:t]`",),
    )


def window_of_window(span: Span) -> Diagnostic:
    """E0604: a window of something that is a window already."""
    return Diagnostic(
        "E0604",
        "error",
        "a window of a window",
        span,
        "this is a window already",
        help="take one window of what it is made of, as long as both together",
    )


def window_not_yet(what: str, span: Span) -> Diagnostic:
    """E0605: a window that this version cannot take."""
    return Diagnostic(
        "E0605",
        "error",
        f"a window of {what} is not in this version of msnn",
        span,
        "planned, not available yet",
    )


def future_of(what: str, span: Span) -> Diagnostic:
    """E0606: the future of something that is not logged."""
    return Diagnostic(
        "E0606",
        "error",
        f"the future of {what} is not known",
        span,
        "reads ahead of t",
        notes=("only logged signals can be read ahead of t",),
        help="in outputs and losses `next(x)` is a state's next value, `x.meas[t+1]` its log",
    )


def bad_length(span: Span) -> Diagnostic:
    """E0607: a window without samples."""
    return Diagnostic("E0607", "error", "a window needs at least one sample", span, "too short")


def window_too_long(samples: int, limit: int, span: Span) -> Diagnostic:
    """E0608: a window beyond any use, most likely a wrong unit."""
    return Diagnostic(
        "E0608",
        "error",
        f"a window of {samples} samples; at most {limit} are allowed",
        span,
        "too long",
        help="check the unit of the duration",
    )


def target_in_step(name: str, output: str, span: Span) -> Diagnostic:
    """E0609: an output that needs what only the log of a training run has."""
    return Diagnostic(
        "E0609",
        "error",
        f"`{output}` reads the log of `{name}`, which a deployed model does not have",
        span,
        "read here",
        help=f"declare `{name}` under `inputs:`, or use it in `losses:` only",
    )


def history_needed(name: str, span: Span) -> Diagnostic:
    """E0610: past values of something that has none at the start of a run."""
    return Diagnostic(
        "E0610",
        "error",
        f"the values of `{name}` before the start are not known",
        span,
        "reads its past",
        notes=("they are neither logged nor do they follow from logged inputs alone",),
        help=f"give `{name}` a `history:`, for example `history: 0`",
    )
