"""E0874, E0901-E0949, W0807, W0808, W0936-W0938: training, metrics, simulation, initial states."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import did_you_mean, nearest


def no_stages() -> Diagnostic:
    """E0901: training without a `train` section."""
    message = "the spec has no `train:` section"
    return error("E0901", None, message, help="the least is `train: [{epochs: 100}]`")


def cannot_close(signal: str, reason: str, span: Span) -> Diagnostic:
    """E0902: a rollout whose loop cannot be closed."""
    return error("E0902", span, f"cannot close {reason}", f"this rollout closes `{signal}`")


def skips_everything(key: str, skip: int, horizon: int, span: Span | None) -> Diagnostic:
    """E0903: a rollout without a scored step."""
    message = f"{key} {skip} leaves nothing of a horizon of {horizon} evaluations"
    return error("E0903", span, message, "nothing is scored")


def no_target_scored(
    stage: str, name: str, span: Span | None, horizon: int | str, starts: Sequence[str]
) -> Diagnostic:
    """E0909: a stage whose losses have no target in the rows of its monitor."""
    message = f"stage `{stage}` has nothing to judge by: no target in the rows of `{name}` counts"
    notes = ("targets are missing, or factors of `rows:` are 0, wherever rollouts score",)
    repair = "look at the columns of the targets with `msnn data SPEC`, or choose other rows"
    if starts and isinstance(horizon, int):
        names = " and ".join(f"`{name}`" for name in starts)
        steps = "one step" if horizon == 1 else f"{horizon} steps"
        notes += (f"rollouts start where {names} is measured, and score {steps} from there",)
        repair = (
            "make `rollout:` as long as the rows from one measured value to the next, or "
            "`rollout: record`; else " + repair
        )
    return error("E0909", span, message, "its losses score nothing", notes=notes, help=repair)


def warms_nothing(span: Span) -> Diagnostic:
    """W0806: a warm-up of a rollout without a closed loop."""
    message = "this rollout closes no signal that `warm_up` could read from the log"
    repair = "to score later evaluations only, write `skip:`"
    return warning("W0806", span, message, "nothing to warm up", help=repair)


def nothing_to_train(stage: str, span: Span) -> Diagnostic:
    """E0904: a stage in which every parameter is frozen, or a model without any."""
    message = f"stage `{stage}` has no parameter to train"
    return error("E0904", span, message, "all parameters are constant here")


def losses_of_others(stage: str, trained: Sequence[str], span: Span) -> Diagnostic:
    """E0934: a stage whose losses do not depend on the parameters that it trains."""
    named = ", ".join(f"`{name}`" for name in trained)
    trained_ones = "it" if len(trained) == 1 else "one of them"
    message = f"stage `{stage}` trains {named}, but no loss with a weight depends on {trained_ones}"
    repair = "give a loss of what depends on them a weight, or train other parameters"
    return error("E0934", span, message, "nothing to learn here", help=repair)


def losses_without_data(
    stage: str, predicted: Sequence[tuple[str, str, int]], span: Span
) -> Diagnostic:
    """W0935: a stage whose losses compare nothing with data."""
    message = f"stage `{stage}` makes losses of parameters alone small, whatever the data are"
    notes = ("with `losses:` what outputs predict counts only where it is listed",)
    # outputs with the signal that each predicts and the samples ahead
    samples = [(name, f"{of}[t+{k}]" if k else f"{of}[t]") for name, of, k in predicted]
    listed = ", ".join(f'{name}: "mse({name}, {sample})"' for name, sample in samples)
    repair = f"add `{listed}`" if predicted else "add a loss of measured values, as `mse(y, z)`"
    return warning("W0935", span, message, "learns from no data", notes=notes, help=repair)


def no_factors_with_lbfgs(span: Span) -> Diagnostic:
    """E0905: learning rates of single parameters with an optimiser that has only one step size."""
    message = "lbfgs has one step length for all parameters"
    repair = "give the parameter a `scale:` instead"
    return error("E0905", span, message, "no factors with lbfgs", help=repair)


def unknown_loss(name: str, span: Span, losses: Iterable[str]) -> Diagnostic:
    """E0906: a loss that the spec does not have."""
    losses = tuple(losses)
    meant = nearest(name, losses)
    message = f"unknown loss `{name}`"
    notes = (f"losses: {', '.join(losses) or 'none'}",)
    repair = did_you_mean(meant)
    return error("E0906", span, message, "not a loss", notes=notes, help=repair, replacement=meant)


def no_objective(stage: str, span: Span) -> Diagnostic:
    """E0907: a stage whose weighted total is always zero."""
    message = f"stage `{stage}` has no loss with a weight above 0"
    repair = "give an output `predicts:` or add `losses:`"
    return error("E0907", span, message, "nothing to minimise", help=repair)


def no_statistic(parameter: str, signal: str, span: Span | None) -> Diagnostic:
    """E0925: statistics of a signal that is constant or missing in the training data."""
    message = (
        f"`{parameter}` cannot be computed: `{signal}` is constant or missing in the set `train`"
    )
    repair = "give `mean` and `std` as numbers"
    return error("E0925", span, message, "`data` needs values that differ", help=repair)


def unknown_statistics(parameters: Iterable[str], span: Span | None) -> Diagnostic:
    """E0926: a model with statistics of the data as parameters, used before training."""
    listed = ", ".join(f"`{name}`" for name in parameters)
    message = f"{listed} are statistics of the training data, which initial weights do not have"
    repair = "train first, or give the weights of a training"
    return error("E0926", span, message, "known after training", help=repair)


def diverged(
    stage: str, epoch: int, what: str, place: str, span: Span | None, repair: str
) -> Diagnostic:
    """E0913: training that produced a value that is not finite."""
    message = f"stage `{stage}` diverged in epoch {epoch}: {what} is not finite {place}"
    label = "the first value that is not finite"
    notes = ("the best weights so far are kept",)
    return error("E0913", span, message, label, notes=notes, help=repair)


def diverged_parameter(
    stage: str, epoch: int, name: str, span: Span | None, *, has_rate: bool
) -> Diagnostic:
    """E0914: a parameter that an optimiser step made infinite or NaN."""
    message = f"stage `{stage}` diverged in epoch {epoch}: a step made `{name}` not finite"
    notes = ("the best weights so far are kept",)
    repair = (
        "try a smaller learning rate or `clip:`"
        if has_rate
        else f"try `min:` and `max:` of `{name}`, or an `init` that is nearer"
    )
    return error("E0914", span, message, "not finite after the step", notes=notes, help=repair)


def no_checkpoint(folder: str) -> Diagnostic:
    """E0915: a run to resume although none was interrupted."""
    return error("E0915", None, f"no interrupted run to resume in {folder}")


def other_checkpoint(folder: str, reason: str) -> Diagnostic:
    """E0916: a checkpoint that cannot be read."""
    repair = "train without `--resume` to begin another run"
    return error("E0916", None, f"cannot resume the run in {folder}: {reason}", help=repair)


def unscorable_target(span: Span) -> Diagnostic:
    """E0917: a metric's target that is more than one logged sample."""
    message = "the target of a metric is one logged sample such as `x[t+1]`"
    return error("E0917", span, message, "not a logged sample")


def nothing_predicted(output: str, span: Span) -> Diagnostic:
    """E0918: a metric of an output that predicts no recorded signal."""
    message = f"`{output}` predicts nothing: the metric has no target"
    repair = 'add `target: "x[t+1]"` here or `predicts:` to the output'
    return error("E0918", span, message, "no target", help=repair)


def unknown_output(name: str, span: Span, outputs: Iterable[str]) -> Diagnostic:
    """E0919: a metric of something that is neither an output nor a loss."""
    outputs = tuple(outputs)
    meant = nearest(name, outputs)
    message = f"`{name}` is neither an output nor a loss"
    notes = (f"known: {', '.join(outputs)}",)
    repair = did_you_mean(meant)
    return error("E0919", span, message, "unknown", notes=notes, help=repair, replacement=meant)


def wrong_limit_unit(limit: str, expected: str, span: Span) -> Diagnostic:
    """E0920: a limit whose unit does not fit the metric."""
    message = f"the limit {limit} does not compare with a metric in {expected}"
    repair = f"give the limit in {expected}, or as a number alone, which is in that unit"
    return error("E0920", span, message, f"the metric is in {expected}", help=repair)


def metric_of_loss(metric: str, name: str, span: Span) -> Diagnostic:
    """E0921: a metric other than `loss` for a loss."""
    message = f"`{metric}` of the loss `{name}` has no meaning: a loss is a number already"
    repair = "leave `metric:` out, or name an output"
    return error("E0921", span, message, "this is a loss", help=repair)


def starts_elsewhere(stage: str, state: str, span: Span | None, *, of_call: bool) -> Diagnostic:
    """W0901: an initial value of a recording's first row, used at other rows."""
    what = f"value with which `{state}` begins" if of_call else f"`init` of `{state}`"
    start = (
        "`skip:` of the rollout, or `init=` of an integral"
        if of_call
        else f"or an `init` that reads the log such as `{state}.meas`"
    )
    message = (
        f"stage `{stage}` starts rollouts inside records, where the fixed {what} need not hold"
    )
    return warning("W0901", span, message, "reads no log", help=f"`rollout: record`, {start}")


def at_bound(name: str, span: Span | None, *, is_pushed: bool) -> Diagnostic:
    """W0904: a parameter that ended at a bound."""
    # only a derivative that points outward says so
    message = f"`{name}` ended at its bound"
    repair = "the true value may lie beyond it" if is_pushed else None
    return warning("W0904", span, message, "at the bound", help=repair)


def stuck_at_bound(name: str, span: Span | None, *, are_squares: bool) -> Diagnostic:
    """W0914: a parameter that stopped near a bound although the loss decreases away from it."""
    message = f"`{name}` stopped near its bound, and the loss falls away from the bound"
    repair = "begin with an `init` farther inside"
    if are_squares:
        repair = f"train on with `levenberg_marquardt`, or {repair}"
    return warning("W0914", span, message, "no minimum", help=repair)


def attempt_left_out(number: int, attempts: int, why: Diagnostic) -> Diagnostic:
    """W0906: an attempt at a stage that diverged while others continue."""
    message = f"run {number} of {attempts} is left out: {why.message}"
    return warning("W0906", why.span, message, why.label)


def no_native_engine(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """E0922: native kernels for a stage, which are not possible."""
    message = f"the stage `{stage}` cannot run natively: {reason}"
    repair = "use `engine: auto` or `engine: torch`"
    return error("E0922", span, message, "native engine", help=repair)


def torch_instead(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """W0905: a stage that runs in torch instead of native kernels."""
    message = f"the stage `{stage}` runs on torch, not in native kernels: {reason}"
    return warning("W0905", span, message, "slower engine")


_FEW = 20
"""Rollouts of validation below which a shorter horizon makes more of them."""


def decides_alone(
    loss: str, share: float, stage: str, others: Sequence[str], span: Span | None
) -> Diagnostic:
    """W0936: a loss that is nearly the whole total of a stage."""
    listed = ", ".join(f"`{name}`" for name in others)
    message = (
        f"`{loss}` is {min(100 * share, 99.99):.4g} % of the total of stage `{stage}`: "
        f"{listed} hardly count{'s' if len(others) == 1 else ''}"
    )
    repair = (
        f"larger weights of the others, as 1/variance of their target: `losses: {{{others[0]}: "
        "WEIGHT}` of the stage"
    )
    return warning("W0936", span, message, "from its first epoch to its last", help=repair)


def hardly_moved(names: Sequence[str], span: Span | None) -> Diagnostic:
    """W0937: parameters that training has hardly moved."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"{listed} moved by less than 1 % of {'its' if len(names) == 1 else 'their'} scale"
    repair = (
        "if that is not where it belongs: `scale: data` of the parameter, a larger `lr`, more "
        "epochs, or `optimizer: levenberg_marquardt`"
    )
    return warning("W0937", span, message, "a step is a part of `scale:`", help=repair)


def validation_decided(
    *,
    stage: str,
    rollouts: int,
    watched: str,
    epoch: int,
    epochs: int,
    is_on_the_way: bool,
    value: float,
    last: float,
    span: Span | None,
) -> Diagnostic:
    """W0938: weights selected by validation that fit the training rows much worse."""
    over = f"{'the only rollout' if rollouts == 1 else f'{rollouts} rollouts'} of `{watched}`"
    # an epoch of a least-squares stage in the middle of its path, or a monitor far above
    if is_on_the_way:
        message = (
            f"stage `{stage}` keeps epoch {epoch} of {epochs}, the best over {over}: "
            f"the loss of training fell from {value:.3g} to {last:.3g} after it"
        )
    else:
        message = (
            f"stage `{stage}`: the loss over {over} is {value:.3g} in epoch {epoch}, the best; "
            f"over those of training it is {last:.3g} in epoch {epochs}, the last"
        )
    shorter = "a shorter `rollout.horizon`, or " if rollouts < _FEW else ""
    repair = f"{shorter}a `split:` that spreads `val` over the records (`by: block`)"
    return warning("W0938", span, message, "these rollouts decide", help=repair)


def undecided_start(
    states: Sequence[str], wanted_by: str, place: str, count: int, over: int | None
) -> Diagnostic:
    """W0807: an estimated initial state that the first samples of its rollout do not determine."""
    which = "what is scored does" if over is None else "the first evaluations do"
    message = (
        f"{wanted_by}: {which} not decide where {_listed(states)} starts, "
        f"from {place}{_more(count)}"
    )
    other = "another `init:`" if over is None else "a longer `over:`, or another `init:`"
    repair = f"what is not decided stays at `from:`; take {other}"
    return warning("W0807", None, message, help=repair)


def guessed_start(
    states: Sequence[str], wanted_by: str, place: str, count: int, over: int
) -> Diagnostic:
    """E0874: an estimated initial state that has an effect, but not on the first samples of its
    rollout.
    """
    message = (
        f"{wanted_by}: the first {over} evaluations do not decide where {_listed(states)} starts, "
        f"and later ones depend on it, from {place}{_more(count)}"
    )
    repair = "write `over: record`, or a longer `over:`; or say by `from:` where such a run starts"
    return error("E0874", None, message, help=repair)


def unsettled_start(states: Sequence[str], wanted_by: str, place: str, count: int) -> Diagnostic:
    """W0808: an estimate of an initial state that did not converge."""
    message = (
        f"{wanted_by}: the search for where {_listed(states)} starts has not converged, "
        f"from {place}{_more(count)}"
    )
    repair = "begin nearer, by `from:`, or take a shorter `over:`"
    return warning("W0808", None, message, help=repair)


def _listed(states: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in states)


def _more(count: int) -> str:
    return f" and {count - 1} other starts" if count > 1 else ""
