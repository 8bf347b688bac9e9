"""E0351, E07xx, E0849-E0852, E1222: states and loops, rows of losses, starts."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def state_without_law(span: Span) -> Diagnostic:
    """E0701: a state without `der` or `next`."""
    message = "a state needs `der:` or `next:`"
    repair = "`der:` is the derivative of a continuous state, `next:` the value of a discrete one"
    return error("E0701", span, message, "nothing says how it moves", help=repair)


def rows_of_no_log(loss: str, read: str, span: Span) -> Diagnostic:
    """E0849: a row factor of a loss that depends on more than recorded data."""
    message = f"`rows` of `{loss}` reads {read}: it says of logged rows how much they count"
    repair = "write it of logged signals: `s`, or `s.meas` for the log of a state"
    return error("E0849", span, message, "not of the log alone", help=repair)


def rows_of_no_rows(loss: str, span: Span) -> Diagnostic:
    """E0351: a row factor of a loss that is the same in every row."""
    message = f"`rows` of `{loss}` counts nothing: learned numbers alone are the same in every row"
    repair = "leave `rows:` out; it belongs to the losses that compare with data"
    return error("E0351", span, message, "of a loss without rows", help=repair)


def too_few_for_starts(names: Sequence[str], over: int, numbers: int, span: Span) -> Diagnostic:
    """E0851: fewer samples than initial values that are to be estimated from them."""
    listed = ", ".join(f"`{name}`" for name in names)
    few = f"{over} evaluation{'' if over == 1 else 's'}"
    message = f"{few} cannot decide the {numbers} numbers that {listed} start from"
    repair = f"`over:` at least {numbers}, better several times as many: the log has noise"
    return error("E0851", span, message, "too few", help=repair)


def starts_of_nothing(name: str, span: Span) -> Diagnostic:
    """E0852: an estimated initial value although no loss compares with data."""
    message = f"nothing decides where `{name}` starts: no loss compares the model with the log"
    repair = "give an output `predicts:`, or a loss such as `mse(y, z)`"
    return error("E0852", span, message, "least squares of what?", help=repair)


def algebraic_loop(names: tuple[str, ...], span: Span) -> Diagnostic:
    """E0702: values that depend on each other within the same step."""
    message = f"algebraic loop: {' → '.join(names)}"
    repair = "break it with a state or a past sample"
    return error("E0702", span, message, "needs its own value in the same step", help=repair)


def not_a_state(function: str, span: Span) -> Diagnostic:
    """E0703: `next` or `flow` of something that is not a state."""
    return error("E0703", span, f"`{function}` takes the name of a state", "not a state")


def simulation_in_init(name: str, span: Span) -> Diagnostic:
    """E0704: an initial value that depends on the simulation."""
    message = f"`init` cannot read the state `{name}`: the simulation has not begun"
    repair = f"write `{name}.meas` for its logged value"
    return error("E0704", span, message, "a simulated value", help=repair)


def no_such_prediction(key: str, name: str, span: Span) -> Diagnostic:
    """E0705: a prediction or an estimate of a value that is not recorded."""
    message = f"`{key}` names `{name}`, which is not an input, target or state"
    return error("E0705", span, message, "not logged")


def flow_of_discrete(name: str, span: Span) -> Diagnostic:
    """E0707: the integrator's result for a state without derivative."""
    message = f"`flow({name})` needs `der:` in the state `{name}`"
    return error("E0707", span, message, "no derivative")


def not_closable(signal: str, span: Span | None, reason: str) -> Diagnostic:
    """E0706: a loop that cannot be closed."""
    return error("E0706", span, f"`{signal}` cannot be closed: {reason}", "closed here")


def nothing_to_act_on(span: Span) -> Diagnostic:
    """E0741: `on_range` of a state without a range."""
    message = "`on_range` needs the state's `range`"
    repair = "add `range: [low, high]`, or leave `on_range` out"
    return error("E0741", span, message, "there is no range that it could leave", help=repair)


def reset_to_the_log(name: str, span: Span | None, *, fitted: bool) -> Diagnostic:
    """E0742: `on_range: reset` of a state whose first value is measured, or fitted to a record."""
    what = "a start that is fitted to each record" if fitted else "an `init` that reads the log"
    message = f"`on_range: reset` cannot take `{name}` back to {what}"
    repair = "give `init` a value that is always known, or write `on_range: saturate`"
    label = "found from logged rows" if fitted else "measured before the first step only"
    return error("E0742", span, message, label, help=repair)


def implicit_of_what(name: str, problem: str, span: Span, repair: str) -> Diagnostic:
    """E1222: something that `linear_implicit: {of: …}` cannot take implicitly."""
    message = f"`linear_implicit` of `{name}`: {problem}"
    return error("E1222", span, message, "of this", help=repair)
