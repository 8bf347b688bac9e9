"""E0865-E0868, E0970-E0972, E1042-E1053, W0950, W0951, W1001-W1003: kernels, devices, processes."""

from collections.abc import Sequence
from pathlib import Path

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest

_REPORT = "please report this with the spec: it is a mistake of msnn, not of the model"


def wrong_kernel(stage: str, what: str, instead: str, span: Span | None) -> Diagnostic:
    """W0950: a training kernel with wrong losses or gradients."""
    label = "its kernel failed the comparison with the interpreter"
    return warning("W0950", span, f"stage `{stage}` goes on {instead}: {what}", label, help=_REPORT)


def kernel_not_made(
    stage: str, reason: str, span: Span | None, *, too_large: bool = False
) -> Diagnostic:
    """W0951: a training kernel that cannot be built although a compiler is installed."""
    fault = "is too large" if too_large else "cannot be made"
    message = f"stage `{stage}` goes on with torch: its kernel {fault} ({reason})"
    smaller = "learn fewer numbers at a time, by `freeze`, or take an optimizer of first order"
    return warning("W0951", span, message, "no kernel", help=smaller if too_large else _REPORT)


def foreign_kernels(folder: Path, reason: str, taken: Path | None) -> Diagnostic:
    """W1001: a folder of compiled kernels that other users may write to."""
    message = f"no kernel is loaded from {folder}, since {reason}; {_kept(taken)}"
    repair = "close it to others (`chmod go-w`), or set MSNN_CACHE to a folder of your own"
    return warning("W1001", None, message, help=repair)


def unusable_kernel_folder(folder: Path, reason: str, taken: Path | None) -> Diagnostic:
    """W1002: a folder of compiled kernels in which no file can be written."""
    message = f"no kernel can be written to {folder} ({reason}); {_kept(taken)}"
    repair = "make room (`msnn doctor --clean-cache`), or set MSNN_CACHE to another folder"
    return warning("W1002", None, message, help=repair)


def foreign_folder_is_not_cleaned(folder: Path, reason: str) -> Diagnostic:
    """E1053: a folder of compiled kernels to clean that other users may write to."""
    repair = "close it to others (`chmod go-w`), or set MSNN_CACHE to the folder that is meant"
    return error("E1053", None, f"nothing is removed from {folder}, since {reason}", help=repair)


def no_native_rollouts(reason: str) -> Diagnostic:
    """E1042: native kernels for a simulation, which are not possible here."""
    repair = "leave `--engine` out, or use `--engine interpreter`"
    return error("E1042", None, f"no kernel can simulate here: {reason}", help=repair)


def unknown_engine(name: str, known: Sequence[str]) -> Diagnostic:
    """E1043: an unknown simulation engine."""
    message = f"there is no engine `{name}`"
    notes = (f"engines: {', '.join(known)}",)
    return error("E1043", None, message, notes=notes, help=did_you_mean(nearest(name, known)))


def stepper_of_words(dtype: str) -> Diagnostic:
    """E1044: a stepper of a model whose C code uses fixed point."""
    message = f"`export: c` says `dtype: {dtype}`, and a stepper takes and gives numbers with units"
    repair = 'load the model with floats: `msnn.load(path, ["export.c.dtype=float32"])`'
    return error("E1044", None, message, help=repair)


def interpreted_instead(reason: str) -> Diagnostic:
    """W1003: a simulation by the interpreter that compiled kernels would finish much sooner."""
    message = f"the interpreter simulates, which takes longer than a kernel: {reason}"
    return warning("W1003", None, message)


def _kept(taken: Path | None) -> str:
    if taken is None:
        return "every command builds its kernels again"
    return f"they are kept in {taken}"


_NAMES = ("cpu", "cuda", "cuda:0", "auto")
_CARDS = ("gpu", "nvidia")


def no_kernel_on_card(stage: str, device: str, span: Span | None) -> Diagnostic:
    """E0970: native kernels on a graphics card."""
    message = f"the stage `{stage}` cannot run on {device}: native kernels are for the CPU"
    repair = "use `engine: auto` or `engine: torch`, or train with `--device cpu`"
    return error("E0970", span, message, "native engine", help=repair)


def unknown_device(name: str) -> Diagnostic:
    """E0971: an unknown device for torch."""
    meant = "cuda" if name.casefold() in _CARDS else nearest(name, _NAMES)
    known = "the devices are cpu, cuda, cuda:N for card N counted from 0, and auto"
    repair = f"did you mean `{meant}`? {known}" if meant else known
    return error("E0971", None, f"`{name}` is no device", help=repair)


def no_such_card(name: str, cards: int) -> Diagnostic:
    """E0972: a graphics card that this machine does not have."""
    there = ", ".join(f"cuda:{number}" for number in range(cards))
    message = f"there is no `{name}` here"
    return error("E0972", None, message, help=f"torch can use {there}; cards are counted from 0")


def no_ranks_in_torch(stage: str, span: Span | None, why: tuple[str, ...]) -> Diagnostic:
    """E0865: a stage of a training with several processes that cannot use a native kernel."""
    message = f"stage `{stage}` runs in torch, and processes share the batches of kernels alone"
    repair = (
        "train it in one process, without torchrun; or let kernels compute it: `engine: native`, "
        "no `--device`, and a C compiler"
    )
    return error("E0865", span, message, "in one process only", notes=why, help=repair)


def ranks_differ(what: str) -> Diagnostic:
    """E0866: processes of one training that differ, for example in spec, data or versions."""
    message = f"the processes of this training differ in {what}"
    repair = (
        "give all of them the same files, the same msnn and numpy, and processors of one kind; "
        "`reproducible: true` in a stage makes kernels round alike on all"
    )
    return error("E0866", None, message, help=repair)


def rank_lost(reason: str, folder: str | None) -> Diagnostic:
    """E0867: a training that ends because one of its processes was lost."""
    message = "training has ended: another of its processes has ended or cannot be reached"
    kept = () if folder is None else (f"the state of the training is kept in {folder}",)
    repair = "the same command with `--resume` goes on, with as many processes or with one"
    return error("E0867", None, message, notes=(*kept, f"gloo says: {reason}"), help=repair)


def one_process_alone(what: str) -> Diagnostic:
    """E0868: an operation that is not supported with several processes."""
    message = f"{what} starts from one process, and torchrun has started several"
    repair = "leave torchrun out: `msnn …`; `--jobs` and `--ray` share the trainings of a sweep"
    return error("E0868", None, message, help=repair)
