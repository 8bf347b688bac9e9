"""E0870, W1004 and W1005: what measuring a trained model finds that its user should know."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def extrapolates(name: str, signal: str, share: float, low: float, high: float) -> Diagnostic:
    """W1004: rows that are measured on where an input was never while training."""
    message = (
        f"in {share:.1%} of the rows scored in `{name}` the input `{signal}` is outside of the "
        f"{low:.4g} … {high:.4g} that was trained on: there the model extrapolates"
    )
    repair = (
        "train on records that reach as far, or choose the sets by `split` under `data:` so that "
        "each has its share"
    )
    return warning("W1004", None, message, help=repair)


def of_another_fold(run: str, trained: int, held_out: int) -> Diagnostic:
    """W1005: rows held out by one fold, of a model that another one was trained without."""
    message = (
        f"the weights in {run} are those of fold {trained}, which was trained on what fold "
        f"{held_out} holds out: errors on these rows are too small"
    )
    return warning("W1005", None, message, help=f"measure that run: `msnn validate {run}`")


def broken_limit(
    *, of: str, metric: str, value: str, limit: str, simulated: str, data: str, span: Span | None
) -> Diagnostic:
    """E0870: a metric of a trained model that does not keep the limit of its entry."""
    message = f"{metric} of `{of}` is {value}, and the limit is {limit}"
    repair = "train again, or change the limit where the model is as good as it has to be"
    notes = (f"measured on `{data}`: {simulated}",)
    return error("E0870", span, message, "does not hold", notes=notes, help=repair)
