"""E0871, E0872 and W0873: what changed from one run of a model to another."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def worse_metric(what: str, old: str, new: str, grown: str, span: Span | None) -> Diagnostic:
    """E0871: a metric is worse than in the run compared with."""
    message = f"{what} was {old} and is {new}: {grown}"
    repair = "train again, or allow more by `--margin PERCENT`"
    return error("E0871", span, message, "is worse than before", help=repair)


def breaking_change(part: str, change: str, breaks: str, span: Span | None) -> Diagnostic:
    """E0872: a change of the interface breaks users of the model."""
    repair = "tell who uses it, or leave the interface as it was"
    return error(
        "E0872", span, f"{part}: {change}", "must be followed", notes=(breaks,), help=repair
    )


def not_measured(which: str, reason: str) -> Diagnostic:
    """W0873: runs are compared without metrics, because data cannot be read."""
    repair = "say where the data of both are: `--data-root FOLDER`"
    return warning("W0873", None, f"metrics of the {which} run are missing: {reason}", help=repair)
