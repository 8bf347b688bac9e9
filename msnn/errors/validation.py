"""W1004: what measuring a trained model finds that its user should know."""

from spec_schema.diagnostics.diagnostic import Diagnostic, warning


def extrapolates(name: str, signal: str, share: float, low: float, high: float) -> Diagnostic:
    """W1004: rows that are measured on where an input was never while training."""
    message = (
        f"in {share:.1%} of the rows scored in `{name}` the input `{signal}` is outside of the "
        f"{low:.4g} … {high:.4g} that was trained on: there the model extrapolates"
    )
    repair = (
        "train on records that reach as far, or let the spec say how far the model is meant to "
        "reach: `range:` of the input"
    )
    return warning("W1004", None, message, help=repair)
