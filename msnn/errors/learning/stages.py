"""E0353, E0940-E0949, W0953: curricula and optimisers of stages, runs that go on, folds, fits."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def misfitting_curriculum(problem: str, span: Span) -> Diagnostic:
    """E0940: a curriculum that does not lead to the horizon of its rollout."""
    message = f"the curriculum does not lead to the horizon: {problem}"
    repair = (
        "`{horizon: 50, curriculum: {20: 5, 40: 20}}` trains on 5 samples up to epoch 20, on "
        "20 up to epoch 40, then on 50"
    )
    return error("E0940", span, message, help=repair)


def much_memory(
    *, stage: str, starts: int, steps: int, step_bytes: int, installed: int, span: Span | None
) -> Diagnostic:
    """W0953: a stage on torch that needs more than half of the memory of the machine."""
    total = starts * steps * step_bytes
    message = (
        f"stage `{stage}` will need about {total / 1e9:.1f} GB: {starts} starts × {steps} steps × "
        f"{step_bytes} bytes; this machine has {installed / 1e9:.1f} GB"
    )
    notes = ("torch keeps the values of all steps of a batch until its gradient is known",)
    repair = "make `batch:` or the horizon smaller, or let kernels train: `engine: native`"
    return warning("W0953", span, message, "much memory", notes=notes, help=repair)


def curriculum_outside_training(span: Span) -> Diagnostic:
    """E0941: a curriculum where nothing is trained."""
    message = "a curriculum belongs to a stage of `train:`"
    repair = "leave it out: a metric is measured over the whole horizon"
    return error("E0941", span, message, "nothing is trained here", help=repair)


def unknown_torch_optimizer(
    name: str, span: Span, known: Iterable[str], why: str | None
) -> Diagnostic:
    """E0942: an optimiser that torch.optim does not have, or that cannot train a model."""
    known = tuple(known)
    meant = nearest(name, known)
    message = f"`{name}` is no optimiser of torch.optim that trains a model"
    notes = (f"those of this version: {', '.join(known)}",)
    repair = did_you_mean(meant) if why is None else None
    word = meant if why is None else None
    label = why or "not among them"
    return error("E0942", span, message, label, notes=notes, help=repair, replacement=word)


def unknown_torch_option(
    option: str, optimizer: str, span: Span, known: Iterable[str]
) -> Diagnostic:
    """E0943: an option that the class of an optimiser does not take, or not from a spec."""
    known = tuple(known)
    meant = nearest(option, known)
    decay = "write `weight_decay:` beside `optimizer:`" if option == "weight_decay" else None
    message = f"`{option}` is no option of {optimizer}"
    notes = (f"options of {optimizer}: {', '.join(known)}",)
    repair = decay or did_you_mean(meant)
    word = None if decay else meant
    return error(
        "E0943", span, message, "not an option", notes=notes, help=repair, replacement=word
    )


def no_weight_decay(optimizer: str, span: Span) -> Diagnostic:
    """E0944: weight decay with an optimiser that has none."""
    message = f"{optimizer} knows no weight decay"
    repair = "add a loss such as `small: l2(W)` instead"
    return error("E0944", span, message, "with `weight_decay:` of the stage", help=repair)


def refused_by_torch(optimizer: str, reason: str, span: Span) -> Diagnostic:
    """E0945: an optimiser that torch refuses to make for these parameters and options."""
    return error("E0945", span, f"torch refuses {optimizer}: {reason}", "as it is set here")


def another_run(folder: str, changes: Sequence[str]) -> Diagnostic:
    """E0946: resuming a run with another spec, other settings or other data."""
    message = f"the run in {folder} cannot go on: it would be another one"
    repair = f"resume as `msnn show {folder}` says, or train without `--resume`"
    return error("E0946", None, message, notes=tuple(changes), help=repair)


def no_folds(span: Span | None) -> Diagnostic:
    """E0947: training every fold of data that are not divided into folds."""
    message = "there are no folds to train: the data are not split `by: kfold`"
    repair = "write `split: {by: kfold, k: 5}` in `data:`, or train without `--folds`"
    return error("E0947", span, message, "" if span is None else "another split", help=repair)


def no_fit(layer: str, target: str, span: Span | None) -> Diagnostic:
    """E0948: a filter to fit to data that do not determine it."""
    few = f"too few rows of its argument and `{target}`"
    message = f"`{layer}` cannot be fitted: the set `train` has {few}"
    label = "`fit` needs more samples in a row than the layer has coefficients"
    repair = "give more data, a lower order, or leave `fit` out"
    return error("E0948", span, message, label, help=repair)


def rate_beyond(stage: str, rate: float, dtype: str, most: float, span: Span | None) -> Diagnostic:
    """E0353: a learning rate that no number of the stage's precision holds."""
    message = f"the stage `{stage}` has the learning rate {rate:g}, which {dtype} has no number for"
    repair = f"it ends at {most:.3g}; useful rates are between 1e-5 and 10, `lr: auto` finds one"
    return error("E0353", span, message, "too large by far", help=repair)


def same_starts(stage: str, attempts: int, span: Span | None) -> Diagnostic:
    """W0940: several runs of a stage that all begin at the same values."""
    message = f"the {attempts} runs of stage `{stage}` begin at the same values: nothing is drawn"
    label = "`starts:` differ by the order of batches alone"
    repair = "draw what they should try: `k: {init: {uniform: {min: 1, max: 100}}}`"
    return warning("W0940", span, message, label, help=repair)
