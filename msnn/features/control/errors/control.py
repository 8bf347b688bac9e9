"""E11xx: the optimal control problem of a predictive controller."""

from collections.abc import Iterable

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def not_a_control(name: str, found: str | None, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1101: `controls` names something that is not an open input of the model."""
    is_what = "which nothing declares" if found is None else f"which is {found}"
    message = f"`controls` names `{name}`, {is_what}"
    # a declared name was not misspelt: it is of the wrong kind
    meant = nearest(name, known) if found is None else None
    repair = did_you_mean(meant) or "a control is an input that nothing inside the model feeds"
    label = "the controller cannot decide it"
    return error("E1101", span, message, label, help=repair, replacement=meant)


def closed_control(name: str, output: str, span: Span, prediction: Span) -> Diagnostic:
    """E1102: a control is an input that an output predicts, so its value is already determined."""
    message = f"`{name}` cannot be a control: `{output}` predicts it"
    return error(
        "E1102",
        span,
        message,
        "fed back along the horizon",
        secondary=((prediction, "fed back from here"),),
        help="name the inputs that act on the plant, or remove `predicts`",
    )


def cost_without_control(name: str, span: Span, control: Span) -> Diagnostic:
    """E1103: the cost does not depend on a control."""
    message = f"the cost does not depend on the control `{name}`"
    repair = "weigh the control, or what it moves: `((y - r) / y_scale)**2`"
    return error(
        "E1103",
        span,
        message,
        "neither directly nor through states",
        secondary=((control, "any value of it is as good"),),
        help=repair,
    )


def reversed_bound(name: str, low: str, high: str, span: Span) -> Diagnostic:
    """E1104: the `min` of a bound is above its `max`."""
    message = f"`min` of `{name}` is {low}, above its `max`, {high}"
    return error("E1104", span, message, "no value keeps both", help="exchange the two")


def blocks_of_other_length(found: int, horizon: int, span: Span) -> Diagnostic:
    """E1105: the `blocks` of the controls do not sum to the horizon."""
    message = f"`blocks` sum to {found}, the horizon has {horizon} samples"
    least = "shorten one by" if found > horizon else "lengthen one by"
    return error("E1105", span, message, f"{found} samples", help=f"{least} {abs(found - horizon)}")


def dropout_in_control(span: Span | None) -> Diagnostic:
    """E1106: the plant or cost of a controller has dropout, which is random."""
    message = "the plant of a predictive controller cannot have dropout"
    repair = "remove it from what the controller computes, or train without it"
    return error("E1106", span, message, "left out at random while training", help=repair)


def bound_of_nothing(span: Span) -> Diagnostic:
    """E1107: a bound has neither `min`, `max` nor `rate`."""
    message = "a bound needs `min`, `max` or `rate`"
    return error("E1107", span, message, "says no limit", help="write for example `{max: 2 bar}`")


def soft_and_hard(span: Span) -> Diagnostic:
    """E1108: a bound is both `soft` and `hard`."""
    message = "a bound is either `soft` or `hard`"
    return error("E1108", span, message, "`hard: true` allows no violation", help="leave one out")


def bound_option(name: str, key: str, kind: str, span: Span) -> Diagnostic:
    """E1109: `rate` bounds something other than a control, or `soft` or `hard` bounds a control."""
    # the two mistakes share a code: a user meets both by moving a bound from one name to another
    is_rate = key == "rate"
    message = f"`{key}` in the bound of `{name}`, which is {kind}"
    label = "only controls have a rate" if is_rate else "bounds of controls always hold"
    repair = f"bound an equation such as `derivative({name})`" if is_rate else "leave it out"
    return error("E1109", span, message, label, help=repair)


def not_bounded(name: str, reason: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1110: `bounds` names something that the controller cannot bound."""
    message = f"`bounds` names `{name}`, {reason}"
    meant = nearest(name, known)
    others = "bounds are of controls, and of states, outputs and equations they move"
    repair = did_you_mean(meant) or others
    return error("E1110", span, message, "cannot be bounded", help=repair, replacement=meant)


def limit_of_model(name: str, key: str, read: str, span: Span) -> Diagnostic:
    """E1111: a limit of a bound depends on values of the model."""
    message = f"`{key}` of `{name}` reads `{read}`: a limit is known before the problem is solved"
    repair = "make it a reference, or bound an equation of the difference"
    return error("E1111", span, message, "a number, or of references", help=repair)


def needless_preview(name: str, found: str, span: Span) -> Diagnostic:
    """E1112: `preview` names something that is not a measured disturbance."""
    message = f"`preview` names `{name}`, which is {found}"
    repair = "a preview is of an input that is neither a control nor fed back"
    return error("E1112", span, message, "has no samples to come", help=repair)


def read_at_other_time(name: str, kind: str, span: Span | None) -> Diagnostic:
    """E1113: the plant reads a control of a later sample, or a reference is shifted in time."""
    if kind == "control":
        message = f"the plant reads the control `{name}` after sample t"
        repair = f"write `between: hold` at `{name}`: a controller holds what it has decided"
        return error("E1113", span, message, "decided at t+1", help=repair)
    message = f"the reference `{name}` is read at another time than its own sample"
    repair = "read it as it is; with `preview: true` each sample of the horizon has its own value"
    return error("E1113", span, message, "only the sample at t+k is there", help=repair)


def terminal_reads_control(name: str, span: Span) -> Diagnostic:
    """E1114: the terminal cost depends on a control at t+N, but the last control acts at t+N-1."""
    message = f"the terminal cost reads the control `{name}` at t+N: the last one acts at t+N-1"
    repair = "write it of states, or of signals that outputs predict"
    return error("E1114", span, message, "depends on it in the same step", help=repair)


def tolerance_of_rounding(tolerance: float, least: float, span: Span) -> Diagnostic:
    """E1115: the `tolerance` of a solver is smaller than rounding errors."""
    message = f"no solver reaches a `tolerance` of {tolerance:g}: rounding leaves more"
    repair = f"write {least:g} or more; 1e-6, the default, is 1e-6 of the scales of the spec"
    return error("E1115", span, message, "below what double precision resolves", help=repair)


def horizon_of_memory(horizon: int, memory: str, products: int, span: Span) -> Diagnostic:
    """E1116: the horizon is so long that the controller needs too much memory."""
    message = f"a horizon of {horizon:,} samples makes a controller of {memory}"
    label = f"about {products:,} products in each of its iterations"
    repair = "look less far ahead, in longer samples, or with a terminal cost for what comes later"
    return error("E1116", span, message, label, help=repair)


def horizon_is_long(horizon: int, memory: str, products: int, span: Span) -> Diagnostic:
    """W1103: the horizon needs more memory than most embedded computers have."""
    message = f"a horizon of {horizon:,} samples makes a controller of {memory}"
    label = f"about {products:,} products in each of its iterations"
    repair = "look less far ahead, in longer samples, or with a terminal cost for what comes later"
    return warning("W1103", span, message, label, help=repair)


def concave_cost(key: str, name: str, span: Span) -> Diagnostic:
    """W1104: the cost is concave, so its minimum lies at a limit or does not exist."""
    message = f"`{key}` bends down in `{name}` wherever it was tried"
    repair = "what is to be kept small is weighed by a positive square: `((y - r) / y_scale)**2`"
    label = f"cheaper the further `{name}` is driven: the optimum lies at a limit, if there is one"
    return warning("W1104", span, message, label, help=repair)


def unused_reference(name: str, span: Span) -> Diagnostic:
    """W1101: neither the cost nor the bounds use a reference."""
    message = f"the reference `{name}` is not used"
    return warning("W1101", span, message, "neither cost nor bounds read it", help="remove it")


def beyond_range(name: str, low: str, high: str, span: Span | None) -> Diagnostic:
    """W1102: the bounds of a control allow values outside the range of its input."""
    message = f"the bounds of `{name}` leave more than its range, {low} … {high}"
    help = f"bound `{name}` by its range, or declare a wider one"
    return warning("W1102", span, message, "the controller may go beyond it", help=help)
