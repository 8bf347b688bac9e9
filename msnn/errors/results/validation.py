"""E0870 and W1004: what measuring a trained model finds that its user should know."""

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


def broken_limit(
    *, of: str, metric: str, value: str, limit: str, simulated: str, data: str, span: Span | None
) -> Diagnostic:
    """E0870: a metric of a trained model that does not keep the limit of its entry."""
    message = f"{metric} of `{of}` is {value}, and the limit is {limit}"
    repair = "train again, or change the limit where the model is as good as it has to be"
    notes = (f"measured on `{data}`: {simulated}",)
    return error("E0870", span, message, "does not hold", notes=notes, help=repair)
