"""E1042-E1044, E1053, W0950, W0951, W1001-W1003: kernels, and where they are kept."""

from collections.abc import Sequence
from pathlib import Path

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest

_REPORT = "please report this with the spec: it is a mistake of msnn, not of the model"


def wrong_kernel(stage: str, what: str, instead: str, span: Span | None) -> Diagnostic:
    """W0950: a training kernel whose losses or slopes are not those of the model."""
    label = "its kernel failed the comparison with the interpreter"
    return warning("W0950", span, f"stage `{stage}` goes on {instead}: {what}", label, help=_REPORT)


def kernel_not_made(
    stage: str, reason: str, span: Span | None, *, too_large: bool = False
) -> Diagnostic:
    """W0951: a training kernel that cannot be built though there is a compiler."""
    fault = "is too large" if too_large else "cannot be made"
    message = f"stage `{stage}` goes on with torch: its kernel {fault} ({reason})"
    smaller = "learn fewer numbers at a time, by `freeze`, or take an optimizer of first order"
    return warning("W0951", span, message, "no kernel", help=smaller if too_large else _REPORT)


def foreign_kernels(folder: Path, reason: str, taken: Path | None) -> Diagnostic:
    """W1001: a folder of kernels into which somebody else could have put one."""
    message = f"no kernel is loaded from {folder}, since {reason}; {_kept(taken)}"
    repair = "close it to others (`chmod go-w`), or set MSNN_CACHE to a folder of your own"
    return warning("W1001", None, message, help=repair)


def unusable_kernel_folder(folder: Path, reason: str, taken: Path | None) -> Diagnostic:
    """W1002: a folder of kernels that takes no new ones."""
    message = f"no kernel can be written to {folder} ({reason}); {_kept(taken)}"
    repair = "make room (`msnn doctor --clean-cache`), or set MSNN_CACHE to another folder"
    return warning("W1002", None, message, help=repair)


def foreign_folder_is_not_cleaned(folder: Path, reason: str) -> Diagnostic:
    """E1053: a folder of kernels to be cleaned that is not the user's alone."""
    repair = "close it to others (`chmod go-w`), or set MSNN_CACHE to the folder that is meant"
    return error("E1053", None, f"nothing is removed from {folder}, since {reason}", help=repair)


def no_native_rollouts(reason: str) -> Diagnostic:
    """E1042: kernels asked for to simulate where there can be none."""
    repair = "leave `--engine` out, or use `--engine interpreter`"
    return error("E1042", None, f"no kernel can simulate here: {reason}", help=repair)


def unknown_engine(name: str, known: Sequence[str]) -> Diagnostic:
    """E1043: an engine of simulations that there is not."""
    message = f"there is no engine `{name}`"
    notes = (f"engines: {', '.join(known)}",)
    return error("E1043", None, message, notes=notes, help=did_you_mean(nearest(name, known)))


def stepper_of_words(dtype: str) -> Diagnostic:
    """E1044: a stepper of a model whose C computes in fixed point."""
    message = f"`export: c` says `dtype: {dtype}`, and a stepper takes and gives numbers with units"
    repair = 'load the model with floats: `msnn.load(path, ["export.c.dtype=float32"])`'
    return error("E1044", None, message, help=repair)


def interpreted_instead(reason: str) -> Diagnostic:
    """W1003: work that kernels would do in a fraction of the time, done by the interpreter."""
    message = f"the interpreter simulates, which takes longer than a kernel: {reason}"
    return warning("W1003", None, message)


def _kept(taken: Path | None) -> str:
    if taken is None:
        return "every command builds its kernels again"
    return f"they are kept in {taken}"
