"""E1120-E1127: estimators of states and parameters."""

from collections.abc import Iterable

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def not_measured(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1120: `measured` names something that is not an output with `predicts`."""
    message = f"`measured` names `{name}`, which is no output with `predicts`"
    meant = nearest(name, known)
    repair = did_you_mean(meant) or "`predicts: s[t]` says which signal is measured of an output"
    label = "nothing says what is measured"
    return error("E1120", span, message, label, help=repair, replacement=meant)


def measured_too_late(name: str, signal: str, span: Span, prediction: Span) -> Diagnostic:
    """E1121: a measured output is not predicted from the states at the sample measured."""
    message = f"what `{name}` predicts of `{signal}` is not of the states at that sample"
    return error(
        "E1121",
        span,
        message,
        "cannot be compared when it is measured",
        secondary=((prediction, "predicted here"),),
        help="measure an output that predicts `s[t]`, or `s[t+1]` of a state or input s",
    )


def not_estimated(
    key: str, name: str, span: Span, known: Iterable[str], *, is_unread: bool
) -> Diagnostic:
    """E1122: a deviation is given for something that is neither a state nor a predicted signal."""
    if is_unread:
        message = f"`{key}` names the state `{name}`, which the model leaves out: nothing reads it"
        repair = f"leave `{name}` out here too, or add an output that depends on it"
        return error("E1122", span, message, "no output depends on it", help=repair)
    message = f"`{key}` names `{name}`, which is neither a state nor a signal that outputs predict"
    meant = nearest(name, known)
    repair, label = did_you_mean(meant), "no memory of the model"
    return error("E1122", span, message, label, help=repair, replacement=meant)


def not_a_read_parameter(name: str, span: Span, known: Iterable[str]) -> Diagnostic:
    """E1123: an estimated parameter is not used by the model."""
    message = f"`parameters` names `{name}`, which is no parameter that the model reads"
    meant = nearest(name, known)
    repair, label = did_you_mean(meant), "nothing measured depends on it"
    return error("E1123", span, message, label, help=repair, replacement=meant)


def nothing_uncertain(span: Span) -> Diagnostic:
    """E1124: the estimator has nothing uncertain to estimate."""
    return error(
        "E1124",
        span,
        "nothing is uncertain, so there is nothing to estimate",
        "`initial`, `process` and `parameters` name nothing that deviates",
        help="say how far states may be off: `initial: {STATE: std}`, `process: {STATE: std}`",
    )


def condensed_window(span: Span) -> Diagnostic:
    """E1125: moving-horizon estimation cannot use `structure: condensed`."""
    return error(
        "E1125",
        span,
        "moving-horizon estimation cannot be solved `condensed`",
        "each sample has its own noise, as many numbers as are uncertain",
        help="leave `structure` out: it is solved stage by stage",
    )


def window_of_memory(horizon: int, memory: str, products: int, span: Span) -> Diagnostic:
    """E1127: the window is so long that the estimator needs too much memory."""
    message = f"a window of {horizon:,} samples makes an estimator of {memory}"
    label = f"about {products:,} products in each of its iterations"
    repair = "look back less far: what lies before is known by the arrival cost"
    return error("E1127", span, message, label, help=repair)
