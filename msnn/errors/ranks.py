"""E0865-E0868: a training in several processes."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def no_ranks_in_torch(stage: str, span: Span | None, why: tuple[str, ...]) -> Diagnostic:
    """E0865: a stage of a training in several processes that no native kernel computes."""
    message = f"stage `{stage}` runs in torch, and processes share the batches of kernels alone"
    repair = (
        "train it in one process, without torchrun; or let kernels compute it: `engine: native`, "
        "no `--device`, and a C compiler"
    )
    return error("E0865", span, message, "in one process only", notes=why, help=repair)


def ranks_differ(what: str) -> Diagnostic:
    """E0866: processes of one training that have not the same."""
    message = f"the processes of this training differ in {what}"
    repair = (
        "give all of them the same files, the same msnn and numpy, and processors of one kind; "
        "`reproducible: true` in a stage makes kernels round alike on all"
    )
    return error("E0866", None, message, help=repair)


def rank_lost(reason: str, folder: str | None) -> Diagnostic:
    """E0867: a training that ends because one of its processes has."""
    message = "training has ended: another of its processes has ended or cannot be reached"
    kept = () if folder is None else (f"the state of the training is kept in {folder}",)
    repair = "the same command with `--resume` goes on, with as many processes or with one"
    return error("E0867", None, message, notes=(*kept, f"gloo says: {reason}"), help=repair)


def one_process_alone(what: str) -> Diagnostic:
    """E0868: what a training in several processes does not do."""
    message = f"{what} starts from one process, and torchrun has started several"
    repair = "leave torchrun out: `msnn …`; `--jobs` and `--ray` share the trainings of a sweep"
    return error("E0868", None, message, help=repair)
