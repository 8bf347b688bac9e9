"""E07xx: states and loops."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def state_without_law(span: Span) -> Diagnostic:
    """E0701: a state that nothing moves."""
    return Diagnostic(
        "E0701",
        "error",
        "a state needs `der:` or `next:`",
        span,
        "nothing says how it moves",
        help="`der:` is the derivative of a continuous state, `next:` the value of a discrete one",
    )


def algebraic_loop(names: tuple[str, ...], span: Span) -> Diagnostic:
    """E0702: values that need each other in the same step."""
    return Diagnostic(
        "E0702",
        "error",
        f"algebraic loop: {' → '.join(names)}",
        span,
        "needs its own value in the same step",
        help="break it with a state or a past sample",
    )


def not_a_state(function: str, span: Span) -> Diagnostic:
    """E0703: `next` or `flow` of something that is not a state."""
    return Diagnostic(
        "E0703", "error", f"`{function}` takes the name of a state", span, "not a state"
    )


def simulation_in_init(name: str, span: Span) -> Diagnostic:
    """E0704: an initial value that reads the simulation it starts."""
    return Diagnostic(
        "E0704",
        "error",
        f"`init` cannot read the state `{name}`: the simulation has not begun",
        span,
        "a simulated value",
        help=f"write `{name}.meas` for its logged value",
    )


def no_such_prediction(key: str, name: str, span: Span) -> Diagnostic:
    """E0705: an output or a fit of something that is not logged."""
    return Diagnostic(
        "E0705",
        "error",
        f"`{key}` names `{name}`, which is not an input, target or state",
        span,
        "not logged",
    )


def flow_of_discrete(name: str, span: Span) -> Diagnostic:
    """E0707: the integrator's result for a state without derivative."""
    return Diagnostic(
        "E0707",
        "error",
        f"`flow({name})` needs `der:` in the state `{name}`",
        span,
        "no derivative",
    )


def not_closable(signal: str, span: Span | None, reason: str) -> Diagnostic:
    """E0706: a loop that cannot be closed."""
    return Diagnostic(
        "E0706", "error", f"`{signal}` cannot be closed: {reason}", span, "closed here"
    )


def nothing_to_act_on(span: Span) -> Diagnostic:
    """E0741: `on_range` of a state without a range."""
    return Diagnostic(
        "E0741",
        "error",
        "`on_range` needs the state's `range`",
        span,
        "there is no range that it could leave",
        help="add `range: [low, high]`, or leave `on_range` out",
    )


def reset_to_the_log(name: str, span: Span | None) -> Diagnostic:
    """E0742: `on_range: reset` of a state whose first value is measured."""
    return Diagnostic(
        "E0742",
        "error",
        f"`on_range: reset` cannot take `{name}` back to an `init` that reads the log",
        span,
        "measured before the first step only",
        help="give `init` a value that is always known, or write `on_range: saturate`",
    )
