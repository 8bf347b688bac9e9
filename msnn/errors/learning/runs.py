"""E0927-E0929, E0980-E0989, W0910-W0912: folders of training runs, and what they keep."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def no_run(folder: str, inside: Sequence[str]) -> Diagnostic:
    """E0980: a folder that is not a training run."""
    where = ", ".join(inside)
    repair = f"there are runs in it: {where}" if inside else "a run is in `runs/NAME/TIME`"
    return error("E0980", None, f"{folder} is no training run: there is no run.json", help=repair)


def unreadable_run(folder: str, writer: str | None) -> Diagnostic:
    """E0981: a training run whose files were changed, or written by another version."""
    message = f"the run in {folder} cannot be read: its files are not as this version writes them"
    repair = (
        "its weights may be good all the same: `msnn validate SPEC --weights "
        f"{folder}/weights.safetensors`"
    )
    notes = () if writer is None else (f"msnn {writer} has written them, and reads them",)
    return error("E0981", None, message, notes=notes, help=repair)


def not_reproducible(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """E0988: a request for reproducible bits with a method that depends on the machine."""
    message = f"the stage `{stage}` cannot be reproducible: {reason}"
    repair = "train with adam, adamw or sgd in native kernels, or leave `reproducible:` out"
    return error("E0988", span, message, "other bits on other machines", help=repair)


def run_not_kept(file: str, reason: str, weights: str | None, *, can_go_on: bool) -> Diagnostic:
    """E0927: a training that ends because its files cannot be written."""
    kept = f"the best weights that could be written are in {weights}"
    message = f"training has ended: cannot write {file}: {reason}"
    notes = (kept if weights is not None else "no weights were written yet",)
    repair = "make room or choose another folder with `--out`, and train again"
    if can_go_on:
        repair = "make room; `--resume` goes on where the last checkpoint was written"
    return error("E0927", None, message, notes=notes, help=repair)


def still_runs(folder: str) -> Diagnostic:
    """E0928: a run to resume that another process is training."""
    message = f"the run in {folder} has not ended: another process trains it"
    repair = "wait for it or end it; train without `--resume` to begin another one"
    return error("E0928", None, message, help=repair)


def nothing_kept(folder: str) -> Diagnostic:
    """E0929: a run whose copies of the spec and sub-models were changed."""
    return error(
        "E0929",
        None,
        f"the run in {folder} has not kept its model: spec or parts are missing or have changed",
        help="name the spec itself, with the weights of the run: `--weights "
        f"{folder}/weights.safetensors`",
    )


def unfinished_run(folder: str, taken: str) -> Diagnostic:
    """W0910: weights of the last completed training, although a newer one is unfinished."""
    message = f"a newer training has not ended: {folder}; these weights are those of {taken}"
    repair = (
        "`msnn train SPEC --resume` goes on with it; where a verb takes a spec it takes this "
        "folder too, with its best weights so far"
    )
    return warning("W0910", None, message, help=repair)


def nothing_learned(stage: str, found: float, span: Span | None, *, has_rate: bool) -> Diagnostic:
    """W0912: a stage in which no epoch is better than the initial weights."""
    message = (
        f"stage `{stage}` has learned nothing: no epoch is better than what it began with, "
        f"{found:.6g}"
    )
    # a step of least squares has no rate: it ends in the minimum that is nearest
    other = "a smaller learning rate" if has_rate else "other initial values"
    repair = f"try {other}; where what it began with is good enough, leave the stage out"
    return warning("W0912", span, message, "its best epoch is 0", help=repair)
