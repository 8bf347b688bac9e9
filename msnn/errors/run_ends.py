"""E0927-E0929, W0910-W0912: what runs keep that end before their time, and what they learned."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def run_not_kept(file: str, reason: str, weights: str | None) -> Diagnostic:
    """E0927: a training that ends because the files of its run cannot be written."""
    kept = f"the best weights that could be written are in {weights}"
    return Diagnostic(
        "E0927",
        "error",
        f"training has ended: cannot write {file}: {reason}",
        None,
        notes=(kept if weights is not None else "no weights were written yet",),
        help="make room or choose another folder with `--out`; `--resume` goes on where the last "
        "checkpoint was written",
    )


def nothing_learned(stage: str, found: float, span: Span | None) -> Diagnostic:
    """W0912: a stage without an epoch that is better than what it began with."""
    return Diagnostic(
        "W0912",
        "warning",
        f"stage `{stage}` has learned nothing: no epoch is better than what it began with, "
        f"{found:.6g}",
        span,
        "its best epoch is 0",
        help="try a smaller learning rate; where what it began with is good enough, leave the "
        "stage out",
    )
