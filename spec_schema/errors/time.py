"""E06xx: time, samples and windows."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def not_a_multiple(
    duration: str, sample_time: str, nearest: Sequence[str], span: Span
) -> Diagnostic:
    """E0601: a duration that is not a whole number of samples."""
    message = f"{duration} is not a multiple of the sample time {sample_time}"
    # the multiples on both sides: which of them is meant only the user knows
    repair = f"write {' or '.join(nearest)}"
    return error("E0601", span, message, "falls between two samples", help=repair)


def needs_sample_time(what: str, span: Span) -> Diagnostic:
    """E0602: a duration or time offset in a model without `sample_time`."""
    message = f"{what} needs a `sample_time:`"
    label = "a model without sample time has independent rows"
    return error("E0602", span, message, label, help="add for example `sample_time: 10 ms`")


def empty_window(span: Span) -> Diagnostic:
    """E0603: a window that ends before it begins."""
    # a note, as the window may be meant the other way round or shorter: there is no one repair
    notes = ("both ends are inclusive, the oldest sample comes first: `x[t-4:t]`",)
    return error("E0603", span, "the window ends before it begins", "empty window", notes=notes)


def window_of_window(span: Span) -> Diagnostic:
    """E0604: a window of something that is a window already."""
    repair = "take one window of what it is made of, as long as both together"
    return error("E0604", span, "a window of a window", "this is a window already", help=repair)


def unkept_past(what: str, span: Span) -> Diagnostic:
    """E0605: a window of a formula that contains memory which cannot be kept."""
    message = f"the past of {what} is not kept for the window around it"
    repair = (
        "give it a name in `equations:`, with a `history:`, and take the window of that name: "
        "`e: {expr: sum(x), history: 0}` and `e.past(3)`"
    )
    return error("E0605", span, message, "has no name", help=repair)


def future_of(what: str, span: Span) -> Diagnostic:
    """E0606: future samples of an expression that is not recorded."""
    message = f"the future of {what} is not known"
    notes = ("only logged signals can be read ahead of t",)
    repair = "in outputs and losses `next(x)` is a state's next value, `x.meas[t+1]` its log"
    return error("E0606", span, message, "reads ahead of t", notes=notes, help=repair)


def bad_length(span: Span) -> Diagnostic:
    """E0607: a window without samples."""
    return error("E0607", span, "a window needs at least one sample", "too short")


def window_too_long(samples: str, limit: int, span: Span) -> Diagnostic:
    """E0608: a window that is too long, probably by a wrong unit."""
    message = f"the window has {samples} samples; at most {limit:,} are allowed"
    # `20 s` at a sample time of 1 ms is the mistake that is made, a number of samples hardly ever
    repair = "check the unit of the duration, or count the samples: `window: 20`, `x.past(20)`"
    return error("E0608", span, message, "too long", help=repair)


def target_in_step(name: str, output: str, span: Span) -> Diagnostic:
    """E0609: an output that needs values which only training data have."""
    message = f"`{output}` reads the log of `{name}`, which a deployed model does not have"
    repair = f"declare `{name}` under `inputs:`, or use it in `losses:` only"
    return error("E0609", span, message, "read here", help=repair)


def history_needed(name: str, span: Span) -> Diagnostic:
    """E0610: past values of something that has none at the start of a run."""
    message = f"the values of `{name}` before the start are not known"
    notes = ("they are neither logged nor do they follow from logged inputs alone",)
    repair = f"give `{name}` a `history:`, for example `history: 0`"
    return error("E0610", span, message, "reads its past", notes=notes, help=repair)
