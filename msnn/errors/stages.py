"""E0940-E0949: curricula and optimisers of training stages, runs that go on, folds, fits."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def misfitting_curriculum(problem: str, span: Span) -> Diagnostic:
    """E0940: a curriculum that does not lead to the horizon of its rollout."""
    return Diagnostic(
        "E0940",
        "error",
        f"the curriculum does not lead to the horizon: {problem}",
        span,
        help="`{horizon: 50, curriculum: {20: 5, 40: 20}}` trains on 5 samples up to epoch 20, on "
        "20 up to epoch 40, then on 50",
    )


def curriculum_outside_training(span: Span) -> Diagnostic:
    """E0941: a curriculum where nothing is trained."""
    return Diagnostic(
        "E0941",
        "error",
        "a curriculum belongs to a stage of `train:`",
        span,
        "nothing is trained here",
        help="leave it out: a metric is measured over the whole horizon",
    )


def unknown_torch_optimizer(
    name: str, span: Span, known: Iterable[str], why: str | None
) -> Diagnostic:
    """E0942: an optimiser that torch.optim does not have, or that cannot train a model."""
    known = tuple(known)
    meant = nearest(name, known)
    return Diagnostic(
        "E0942",
        "error",
        f"`{name}` is no optimiser of torch.optim that trains a model",
        span,
        why or "not among them",
        notes=(f"those of this version: {', '.join(known)}",),
        help=f"did you mean `{meant}`?" if meant and why is None else None,
    )


def unknown_torch_option(
    option: str, optimizer: str, span: Span, known: Iterable[str]
) -> Diagnostic:
    """E0943: an option that the class of an optimiser does not take, or not from a spec."""
    known = tuple(known)
    meant = nearest(option, known)
    decay = "write `weight_decay:` beside `optimizer:`" if option == "weight_decay" else None
    return Diagnostic(
        "E0943",
        "error",
        f"`{option}` is no option of {optimizer}",
        span,
        "not an option",
        notes=(f"options of {optimizer}: {', '.join(known)}",),
        help=decay or (f"did you mean `{meant}`?" if meant else None),
    )


def no_weight_decay(optimizer: str, span: Span) -> Diagnostic:
    """E0944: weight decay with an optimiser that has none."""
    return Diagnostic(
        "E0944",
        "error",
        f"{optimizer} knows no weight decay",
        span,
        "with `weight_decay:` of the stage",
        help="add a loss such as `small: l2(W)` instead",
    )


def refused_by_torch(optimizer: str, reason: str, span: Span) -> Diagnostic:
    """E0945: an optimiser that torch refuses to make for these parameters and options."""
    return Diagnostic(
        "E0945",
        "error",
        f"torch refuses {optimizer}: {reason}",
        span,
        "as it is set here",
    )


def another_run(folder: str, changes: Sequence[str]) -> Diagnostic:
    """E0946: resuming a run with another spec, other settings or other data."""
    return Diagnostic(
        "E0946",
        "error",
        f"the run in {folder} cannot go on: it would be another one",
        None,
        notes=tuple(changes),
        help=f"resume as `msnn show {folder}` says, or train without `--resume`",
    )


def no_folds(span: Span | None) -> Diagnostic:
    """E0947: training every fold of data that are not divided into folds."""
    return Diagnostic(
        "E0947",
        "error",
        "there are no folds to train: the data are not split `by: kfold`",
        span,
        "" if span is None else "another split",
        help="write `split: {by: kfold, k: 5}` in `data:`, or train without `--folds`",
    )


def no_fit(layer: str, input: str, target: str, span: Span | None) -> Diagnostic:
    """E0948: a filter to fit to data that do not determine it."""
    return Diagnostic(
        "E0948",
        "error",
        f"`{layer}` cannot be fitted: the set `train` has too few rows of `{input}` and `{target}`",
        span,
        "`fit` needs more samples in a row than the layer has coefficients",
        help="give more data, a lower order, or leave `fit` out",
    )


def same_starts(stage: str, attempts: int, span: Span | None) -> Diagnostic:
    """W0940: several runs of a stage that all begin at the same values."""
    return Diagnostic(
        "W0940",
        "warning",
        f"the {attempts} runs of stage `{stage}` begin at the same values: nothing is drawn",
        span,
        "`starts:` differ by the order of batches alone",
        help="draw what they should try: `k: {init: {uniform: {min: 1, max: 100}}}`",
    )
