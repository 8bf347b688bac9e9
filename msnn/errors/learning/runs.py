"""E0980-E0989: folders of training runs, and what runs can promise."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def no_run(folder: str, inside: Sequence[str]) -> Diagnostic:
    """E0980: a folder to show that no training has written."""
    where = ", ".join(inside)
    repair = f"there are runs in it: {where}" if inside else "a run is in `runs/NAME/TIME`"
    return error("E0980", None, f"{folder} is no training run: there is no run.json", help=repair)


def unreadable_run(folder: str, writer: str | None) -> Diagnostic:
    """E0981: a training run whose files another version or hand has written."""
    message = f"the run in {folder} cannot be read: its files are not as this version writes them"
    repair = (
        "its weights may be good all the same: `msnn validate SPEC --weights "
        f"{folder}/weights.safetensors`"
    )
    notes = () if writer is None else (f"msnn {writer} has written them, and reads them",)
    return error("E0981", None, message, notes=notes, help=repair)


def not_reproducible(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """E0988: the same bits asked of what has others on other machines."""
    message = f"the stage `{stage}` cannot be reproducible: {reason}"
    repair = "train with adam, adamw or sgd in native kernels, or leave `reproducible:` out"
    return error("E0988", span, message, "other bits on other machines", help=repair)
