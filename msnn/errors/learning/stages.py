"""E0353, E0930-E0949, E0966-E0985, W0744, W0911-W0915, W0953: settings and results of stages."""

from collections.abc import Iterable, Mapping, Sequence

from compiler.ir.slopes import LARGEST_SLOPE
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
    """E0941: a curriculum outside training."""
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
    """E0943: an option that an optimiser of torch does not have, or that a spec cannot give."""
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
    """E0946: a run to resume with another spec, other settings or other data."""
    message = f"the run in {folder} cannot go on: it would be another one"
    repair = f"resume as `msnn show {folder}` says, or train without `--resume`"
    return error("E0946", None, message, notes=tuple(changes), help=repair)


def no_folds(span: Span | None) -> Diagnostic:
    """E0947: a cross-validation of data without folds."""
    message = "there are no folds to train: the data are not split `by: kfold`"
    repair = "write `split: {by: kfold, k: 5}` in `data:`, or train without `--folds`"
    return error("E0947", span, message, "" if span is None else "another split", help=repair)


def no_fit(layer: str, target: str, span: Span | None) -> Diagnostic:
    """E0948: a filter to be fitted to data that do not determine it."""
    few = f"too few rows of its argument and `{target}`"
    message = f"`{layer}` cannot be fitted: the set `train` has {few}"
    label = "`fit` needs more samples in a row than the layer has coefficients"
    repair = "give more data, a lower order, or leave `fit` out"
    return error("E0948", span, message, label, help=repair)


def rate_beyond(stage: str, rate: float, dtype: str, most: float, span: Span | None) -> Diagnostic:
    """E0353: a learning rate that is too large for the number type of the stage."""
    message = f"the stage `{stage}` has the learning rate {rate:g}, which {dtype} has no number for"
    repair = f"it ends at {most:.3g}; useful rates are between 1e-5 and 10, `lr: auto` finds one"
    return error("E0353", span, message, "too large by far", help=repair)


def same_starts(stage: str, attempts: int, span: Span | None) -> Diagnostic:
    """W0940: several attempts at a stage that all have the same initial weights."""
    message = f"the {attempts} runs of stage `{stage}` begin at the same values: nothing is drawn"
    label = "`starts:` differ by the order of batches alone"
    repair = "draw what they should try: `k: {init: {uniform: {min: 1, max: 100}}}`"
    return warning("W0940", span, message, label, help=repair)


def nothing_beside_priors(names: Sequence[str], stage: str, span: Span | None) -> Diagnostic:
    """E0966: priors in a stage that compares nothing with data."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"stage `{stage}` cannot weigh the prior of {listed}: no loss compares with the data"
    repair = "give a loss of measured values a weight, as `mse(y, z)`, or freeze what has a prior"
    return error("E0966", span, message, "no residuals here", help=repair)


def no_corner(loss: str, optimizer: str, stage: str, span: Span | None) -> Diagnostic:
    """W0911: a penalty whose zeros the optimiser of a stage cannot reach."""
    message = f"stage `{stage}` makes numbers small by `{loss}`, but none exactly 0"
    repair = "take adam, adamw, sgd or levenberg_marquardt for exact zeros"
    return warning("W0911", span, message, f"{optimizer} follows slopes alone", help=repair)


def jumps_late(
    *,
    stage: str,
    epoch: int,
    ratio: float,
    key: str,
    rate: str,
    schedule: str | None,
    span: Span | None,
) -> Diagnostic:
    """W0913: a monitor that jumps late in a stage."""
    jump = f"after epoch {epoch} the monitor is {ratio:.3g} times its best"
    message = f"stage `{stage}` does not settle: {jump}"
    lower = f"`{key}: {rate}`"
    repair = lower if schedule is None else f"`{schedule}: {{cosine: {{}}}}`, or {lower}"
    return warning("W0913", span, message, "its steps stay too long", help=f"write {repair}")


def no_scale_of_data(name: str, span: Span | None) -> Diagnostic:
    """E0969: `scale: data` for a parameter that has no effect on a prediction."""
    message = f"`{name}` has no scale in the data: nothing that is compared changes with it"
    repair = "give its typical size as a number, or an `init` from which it has an effect"
    return error("E0969", span, message, "no effect where training begins", help=repair)


_SHOWN = 6
"""Numbers of a change that are named, the largest first."""


def no_sum_of_squares(
    loss: str, what: str, span: Span | None, stage: str, *, is_penalty: bool
) -> Diagnostic:
    """E0930: a loss that is no sum of squares, in a stage with levenberg_marquardt."""
    message = f"stage `{stage}` cannot minimise the loss `{loss}`: {what} is no sum of squares"
    repair = (
        f"write it with mse, l2 or huber, give the stage `losses: {{{loss}: 0}}`, or take "
        "another optimizer"
    )
    if is_penalty:
        repair = (
            "write l1 of a learned array without bounds, with factors outside: `2 * l1(f.weight)`; "
            "or take l2, or another optimizer"
        )
    label = "levenberg_marquardt takes mse, l2, huber, and l1 and group of learned arrays"
    return error("E0930", span, message, label, help=repair)


def not_of_second_order(key: str, reason: str, span: Span) -> Diagnostic:
    """E0931: a key of a stage that has no effect with levenberg_marquardt."""
    message = f"levenberg_marquardt takes no `{key}:`: {reason}"
    repair = f"leave `{key}:` out"
    return error("E0931", span, message, f"with `{key}:` in the same stage", help=repair)


def no_finite_slope(
    stage: str, epoch: int, parameters: Sequence[str], span: Span | None
) -> Diagnostic:
    """E0985: a finite loss whose derivative is infinite or NaN."""
    where = f" in {' and '.join(f'`{name}`' for name in parameters)}" if parameters else ""
    message = f"stage `{stage}` ends in epoch {epoch}: the loss is finite, its slope{where} is not"
    notes = ("the best weights so far are kept",)
    repair = (
        "roots, logarithms and powers are infinitely steep at 0: keep their arguments away "
        "from it (`sqrt(x + 1e-6)`), or begin elsewhere"
    )
    return error("E0985", span, message, "no finite slope here", notes=notes, help=repair)


def left_out(stage: str, span: Span | None) -> Diagnostic:
    """W0744: infinite derivatives in training, which its steps ignore."""
    message = f"in stage `{stage}` a scored value has an infinite slope in a learned number"
    notes = (
        "levenberg_marquardt leaves out such values, other optimizers the batches with them",
        "the losses count them all the same",
        f"slopes above {LARGEST_SLOPE:g} in multiples of the `scale` of a number count as infinite",
    )
    repair = (
        "roots, logarithms and powers are infinitely steep at 0: keep their arguments away "
        "from it (`sqrt(x + 1e-6)`); of rollouts that grow without bound shorten the horizon, "
        "and give tiny numbers a `scale`"
    )
    return warning("W0744", span, message, "no step is made of it", notes=notes, help=repair)


def not_identifiable(
    changes: Sequence[Mapping[str, float]],
    concerned: Mapping[str, tuple[int, int]],
    black_boxes: Sequence[str],
    span: Span | None,
) -> Diagnostic:
    """W0930: parameters that the data do not determine: they can change together without any
    effect.
    """
    # of each parameter: how many of its numbers are in the changes, and how many it has
    named = " and ".join(
        f"`{name}`" if size == 1 else f"{count} of the {size} numbers of `{name}`"
        for name, (count, size) in concerned.items()
    )
    others = f" with {' and '.join(f'`{name}`' for name in black_boxes)}" if black_boxes else ""
    alone = not others and all(len(change) == 1 for change in changes)
    many = sum(count for count, _ in concerned.values()) > 1
    verb = ("do not show" if many else "does not show") if alone else "show only in combination"
    if not alone and not many:
        verb = "shows only in combination"
    first = sorted(changes[0].items(), key=lambda item: -abs(item[1]))
    moves = ", ".join(f"{name} {factor:+.3g}" for name, factor in first[:_SHOWN])
    if len(first) > _SHOWN:
        moves += f" and {len(first) - _SHOWN} smaller ones"
    moves += others and f"{others} in its place"
    said = (
        f"this change leaves every residual as it is: {moves}"
        if len(changes) == 1
        else f"{len(changes)} changes leave every residual as it is, one of them: {moves}"
    )
    message = f"{named} {verb}{others} in the training data"
    repair = (
        "hold some at known values with `learn: false`, shorten windows, or record data that "
        "excite them"
    )
    return warning("W0930", span, message, "not identifiable", notes=(said,), help=repair)
