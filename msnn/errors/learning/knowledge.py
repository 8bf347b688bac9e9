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


def jumps_late(
    *,
    stage: str,
    epoch: int,
    ratio: float,
    key: str,
    rate: str,
    schedule: str | None,
    span: Span | None,
) -> Diagnostic:
    """W0913: a monitor that jumps when a stage ought to settle."""
    jump = f"after epoch {epoch} the monitor is {ratio:.3g} times its best"
    message = f"stage `{stage}` does not settle: {jump}"
    lower = f"`{key}: {rate}`"
    repair = lower if schedule is None else f"`{schedule}: {{cosine: {{}}}}`, or {lower}"
    return warning("W0913", span, message, "its steps stay too long", help=f"write {repair}")


def no_scale_of_data(name: str, span: Span | None) -> Diagnostic:
    """E0969: a scale to be taken from data on which a parameter has no effect."""
    message = f"`{name}` has no scale in the data: nothing that is compared changes with it"
    repair = "give its typical size as a number, or an `init` from which it has an effect"
    return error("E0969", span, message, "no effect where training begins", help=repair)
