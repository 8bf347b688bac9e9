"""E0711-E0719, W0743: integrals, derivatives and gradients."""

from collections.abc import Iterable, Mapping, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def gradient_of_unrelated(x: str, span: Span, y_span: Span) -> Diagnostic:
    """E0711: a gradient with respect to something that the value does not use."""
    return error(
        "E0711",
        span,
        f"this value does not depend on `{x}` within the sample",
        "its gradient would be 0 whatever the data",
        secondary=((y_span, f"nothing in it uses `{x}` at this time"),),
        notes=("`grad(y, x)` takes the past of a model, its states and buffers, as given",),
    )


def not_a_variable(what: str, span: Span, repair: str | None = None) -> Diagnostic:
    """E0712: a gradient with respect to something that is not a signal, state or equation."""
    return error(
        "E0712",
        span,
        f"`grad` cannot be taken with respect to {what}",
        "not an input, state or equation",
        help=repair or "give it a name in `equations:`, and use that name in the value",
    )


def unknown_method(function: str, found: str, known: Iterable[str], span: Span) -> Diagnostic:
    """E0713: a method that `integral` or `der` does not have."""
    known = tuple(known)
    meant = nearest(found, known)
    message = f"`{function}` has no method `{found}`"
    repair = did_you_mean(meant)
    return error(
        "E0713", span, message, f"one of {', '.join(known)}", help=repair, replacement=meant
    )


def derivative_ahead(method: str, span: Span) -> Diagnostic:
    """E0714: a derivative that reads samples after t of an expression that is not recorded."""
    message = f"`method={method}` reads ahead of t, which only a log can"
    repair = "it is for `losses:` and `init:`, of signals such as `x.meas`"
    return error("E0714", span, message, "not a logged signal", help=repair)


def memory_at_another_time(function: str, span: Span) -> Diagnostic:
    """E0715: a window or an earlier sample of an expression with memory."""
    message = f"`{function}` keeps memory here: only its value at t is known"
    repair = "give it a name in `equations:` with a `history:`, and take the window of that name"
    return error("E0715", span, message, "needed at another time", help=repair)


def memory_of_window(function: str, span: Span) -> Diagnostic:
    """E0716: an integral or a remembered value of a whole window."""
    message = f"`{function}` runs in time: its argument must be one sample, not a window"
    repair = "the integral along a window w is `dt * sum(w)`"
    return error("E0716", span, message, "this is a window", help=repair)


def method_takes_state(state: str, span: Span) -> Diagnostic:
    """E0717: a method for the derivative of a state that has a right-hand side."""
    message = "the derivative of a continuous state is its right-hand side, whatever the method"
    repair = f"leave `method=` out, or take the derivative of its log, `{state}.meas`"
    return error("E0717", span, message, "has no meaning here", help=repair)


def too_large_to_solve(found: int, limit: int, span: Span) -> Diagnostic:
    """E0718: a system of linear equations that is too large."""
    message = (
        f"`linear_implicit` solves for all continuous states at once: at most {limit}, not {found}"
    )
    repair = "use `semi_implicit` or `rk4`, or more of its substeps"
    return error("E0718", span, message, f"{found} numbers in all", help=repair)


_AWAY = {
    "/": "divide by what cannot be 0 (`x / (1e-6 + abs(y))`), guard it by `where`",
    "log": "keep its argument above 0 (`log(max(x, 1e-6))`)",
    "sqrt": "keep its argument above 0 (`sqrt(x + 1e-6)`)",
    "pow": "keep its base above 0 (`(x + 1e-6) ** y`)",
    "asin": "keep its argument inside (`asin(clip(x, -0.999, 0.999))`)",
    "acos": "keep its argument inside (`acos(clip(x, -0.999, 0.999))`)",
}


def steep_within_ranges(
    operation: str,
    at: Sequence[float],
    declared: Mapping[str, tuple[float, float]],
    reached: tuple[float, float],
    span: Span,
) -> Diagnostic:
    """W0743: an operation whose derivative is infinite inside the declared ranges."""
    # of a power the base alone is judged: its slope is infinite at 0 where the exponent is below 1
    what = {"/": "the divisor", "pow": "the base"}.get(operation, "the argument")
    where = " or ".join(f"{value:g}" for value in at)
    ranges = " and ".join(f"`{n}` in [{low:g}, {high:g}]" for n, (low, high) in declared.items())
    message = f"the slope is infinite where {what} is {where}, which declared ranges allow"
    return warning(
        "W0743",
        span,
        message,
        f"{what} can be {where}",
        notes=(f"with {ranges} it is in [{reached[0]:.4g}, {reached[1]:.4g}]",),
        help=f"{_AWAY[operation]}, or declare a range in which it does not happen",
    )
