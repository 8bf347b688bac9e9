"""E0980-E0989: folders of training runs, and what runs can promise."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def no_run(folder: str, inside: Sequence[str]) -> Diagnostic:
    """E0980: a folder to show that no training has written."""
    where = ", ".join(inside)
    return Diagnostic(
        "E0980",
        "error",
        f"{folder} is no training run: there is no run.json",
        None,
        help=f"there are runs in it: {where}" if inside else "a run is in `runs/NAME/TIME`",
    )


def unreadable_run(folder: str) -> Diagnostic:
    """E0981: a training run whose files another version or hand has written."""
    return Diagnostic(
        "E0981",
        "error",
        f"the run in {folder} cannot be read: its files are not as this version writes them",
        None,
        help="its weights may be good all the same: `msnn validate SPEC --weights "
        f"{folder}/weights.safetensors`",
    )


def not_reproducible(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """E0988: the same bits asked of what has others on other machines."""
    return Diagnostic(
        "E0988",
        "error",
        f"the stage `{stage}` cannot be reproducible: {reason}",
        span,
        "other bits on other machines",
        help="train with adam, adamw or sgd in native kernels, or leave `reproducible:` out",
    )
