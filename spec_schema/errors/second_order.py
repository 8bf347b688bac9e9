"""E0930-E0939: second-order training, and what it says of the learned parameters."""

from collections.abc import Mapping

from spec_schema.diagnostics import Diagnostic
from spec_schema.source import Span


def no_sum_of_squares(
    loss: str, measure: str, weight: float, span: Span | None, stage: str
) -> Diagnostic:
    """E0930: a loss that is no sum of squares, in a stage of levenberg_marquardt."""
    what = "a negative share" if weight < 0 else "an expression" if measure == "mean" else measure
    return Diagnostic(
        "E0930",
        "error",
        f"stage `{stage}` cannot minimise the loss `{loss}`: {what} is no sum of squares",
        span,
        "levenberg_marquardt takes mse, l2 and huber",
        help=f"write it with mse, l2 or huber, give the stage `losses: {{{loss}: 0}}`, or take "
        "another optimizer",
    )


def not_of_second_order(key: str, reason: str, span: Span) -> Diagnostic:
    """E0931: a key of a stage that levenberg_marquardt has no use for."""
    return Diagnostic(
        "E0931",
        "error",
        f"levenberg_marquardt takes no `{key}:`: {reason}",
        span,
        f"with `{key}:` in the same stage",
        help=f"leave `{key}:` out",
    )


def not_identifiable(change: Mapping[str, float], span: Span | None) -> Diagnostic:
    """W0930: learned numbers that can change together without a change of any residual."""
    names = " and ".join(f"`{name}`" for name in change)
    moves = ", ".join(f"{name} {factor:+.3g}" for name, factor in change.items())
    only = "does not show" if len(change) == 1 else "show only in combination"
    return Diagnostic(
        "W0930",
        "warning",
        f"{names} {only} in the training data",
        span,
        "not identifiable",
        notes=(f"this change leaves every residual as it is: {moves}",),
        help="hold one of them at a known value with `learn: false`, or record data that excite it",
    )
