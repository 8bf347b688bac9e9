"""E0966, E0969, W0911, W0913-W0915: what stages know beside the data, and their rates."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def nothing_beside_priors(names: Sequence[str], stage: str, span: Span | None) -> Diagnostic:
    """E0966: priors in a stage without residuals to weigh them against."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"stage `{stage}` cannot weigh the prior of {listed}: no loss compares with the data"
    repair = "give a loss of measured values a weight, as `mse(y, z)`, or freeze what has a prior"
    return error("E0966", span, message, "no residuals here", help=repair)


def no_corner(loss: str, optimizer: str, stage: str, span: Span | None) -> Diagnostic:
    """W0911: a penalty whose corner the optimiser of a stage does not come to."""
    message = f"stage `{stage}` makes numbers small by `{loss}`, but none exactly 0"
    repair = "take adam, adamw, sgd or levenberg_marquardt for exact zeros"
    return warning("W0911", span, message, f"{optimizer} follows slopes alone", help=repair)
