"""W0950-W0954: training kernels that are no good, a mistake of msnn's own."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span

_REPORT = "please report this with the spec: it is a mistake of msnn, not of the model"


def wrong_kernel(stage: str, what: str, instead: str, span: Span | None) -> Diagnostic:
    """W0950: a training kernel whose losses or slopes are not those of the model."""
    return Diagnostic(
        "W0950",
        "warning",
        f"stage `{stage}` goes on {instead}: {what}",
        span,
        "its kernel failed the comparison with the interpreter",
        help=_REPORT,
    )


def kernel_not_made(stage: str, reason: str, instead: str, span: Span | None) -> Diagnostic:
    """W0951: a training kernel that cannot be built though there is a compiler."""
    return Diagnostic(
        "W0951",
        "warning",
        f"stage `{stage}` goes on {instead}: its kernel cannot be made ({reason})",
        span,
        "no kernel",
        help=_REPORT,
    )
