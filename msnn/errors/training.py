"""E0901-E0949: training, weights, metrics and simulation."""

from collections.abc import Iterable, Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest


def no_stages() -> Diagnostic:
    """E0901: training without a `train` section."""
    return Diagnostic(
        "E0901",
        "error",
        "the spec has no `train:` section",
        None,
        help="the least is `train: [{epochs: 100}]`",
    )


def cannot_close(signal: str, reason: str, span: Span) -> Diagnostic:
    """E0902: a rollout whose loop cannot be closed."""
    return Diagnostic(
        "E0902", "error", f"cannot close {reason}", span, f"this rollout closes `{signal}`"
    )


def skips_everything(skip: int, horizon: int, span: Span) -> Diagnostic:
    """E0903: a rollout that scores nothing."""
    return Diagnostic(
        "E0903",
        "error",
        f"skip {skip} leaves nothing of a horizon of {horizon} evaluations",
        span,
        "nothing is scored",
    )


def nothing_to_train(stage: str, span: Span) -> Diagnostic:
    """E0904: a stage in which every parameter is frozen, or a model without any."""
    return Diagnostic(
        "E0904",
        "error",
        f"stage `{stage}` has no parameter to train",
        span,
        "all parameters are constant here",
    )


def losses_of_others(stage: str, trained: Sequence[str], span: Span) -> Diagnostic:
    """E0934: a stage whose losses say nothing of what it trains."""
    named = ", ".join(f"`{name}`" for name in trained)
    return Diagnostic(
        "E0934",
        "error",
        f"stage `{stage}` trains {named}, but no loss with a weight depends on "
        f"{'it' if len(trained) == 1 else 'one of them'}",
        span,
        "nothing to learn here",
        help="give a loss of what depends on them a weight, or train other parameters",
    )


def no_factors_with_lbfgs(span: Span) -> Diagnostic:
    """E0905: learning rates of single parameters with an optimiser that has one step length."""
    return Diagnostic(
        "E0905",
        "error",
        "lbfgs has one step length for all parameters",
        span,
        "no factors with lbfgs",
        help="give the parameter a `scale:` instead",
    )


def unknown_loss(name: str, span: Span, losses: Iterable[str]) -> Diagnostic:
    """E0906: a loss that the spec does not have."""
    losses = tuple(losses)
    meant = nearest(name, losses)
    return Diagnostic(
        "E0906",
        "error",
        f"unknown loss `{name}`",
        span,
        "not a loss",
        notes=(f"losses: {', '.join(losses) or 'none'}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def no_objective(stage: str, span: Span) -> Diagnostic:
    """E0907: a stage whose weighted total is always zero."""
    return Diagnostic(
        "E0907",
        "error",
        f"stage `{stage}` has no loss with a weight above 0",
        span,
        "nothing to minimise",
        help="give an output `predicts:` or add `losses:`",
    )


def no_statistic(parameter: str, signal: str, span: Span | None) -> Diagnostic:
    """E0925: statistics of a signal that is constant or missing in the training data."""
    return Diagnostic(
        "E0925",
        "error",
        f"`{parameter}` cannot be computed: `{signal}` is constant or missing in the set `train`",
        span,
        "`data` needs values that differ",
        help="give `mean` and `std` as numbers",
    )


def unknown_statistics(parameters: Iterable[str], span: Span | None) -> Diagnostic:
    """E0926: statistics of the data where nothing was trained."""
    listed = ", ".join(f"`{name}`" for name in parameters)
    return Diagnostic(
        "E0926",
        "error",
        f"{listed} are statistics of the training data, which initial weights do not have",
        span,
        "known after training",
        help="train first, or give the weights of a training",
    )


def diverged(
    stage: str, epoch: int, what: str, place: str, span: Span | None, *, second_order: bool
) -> Diagnostic:
    """E0913: training that produced a value that is not finite."""
    first = (
        "weights to begin with that are nearer"
        if second_order
        else "a smaller learning rate, `clip:`"
    )
    return Diagnostic(
        "E0913",
        "error",
        f"stage `{stage}` diverged in epoch {epoch}: {what} is not finite {place}",
        span,
        "the first value that is not finite",
        notes=("the best weights so far are kept",),
        help=f"try {first}, a shorter horizon, or bounds",
    )


def diverged_parameter(stage: str, epoch: int, name: str, span: Span | None) -> Diagnostic:
    """E0914: a parameter that an optimiser step made infinite or NaN."""
    return Diagnostic(
        "E0914",
        "error",
        f"stage `{stage}` diverged in epoch {epoch}: a step made `{name}` not finite",
        span,
        "not finite after the step",
        notes=("the best weights so far are kept",),
        help="try a smaller learning rate or `clip:`",
    )


def no_checkpoint(folder: str) -> Diagnostic:
    """E0915: resuming where nothing was interrupted."""
    return Diagnostic("E0915", "error", f"no interrupted run to resume in {folder}", None)


def other_checkpoint(folder: str, reason: str) -> Diagnostic:
    """E0916: a checkpoint that cannot be read."""
    return Diagnostic("E0916", "error", f"cannot resume the run in {folder}: {reason}", None)


def unscorable_target(span: Span) -> Diagnostic:
    """E0917: a metric's target that is more than one logged sample."""
    return Diagnostic(
        "E0917",
        "error",
        "the target of a metric is one logged sample such as `x[t+1]`",
        span,
        "not a logged sample",
    )


def nothing_predicted(output: str, span: Span) -> Diagnostic:
    """E0918: a metric of an output that stands for nothing logged."""
    return Diagnostic(
        "E0918",
        "error",
        f"`{output}` predicts nothing: the metric has no target",
        span,
        "no target",
        help='add `target: "x[t+1]"` here or `predicts:` to the output',
    )


def unknown_output(name: str, span: Span, outputs: Iterable[str]) -> Diagnostic:
    """E0919: a metric of something that is neither an output nor a loss."""
    outputs = tuple(outputs)
    meant = nearest(name, outputs)
    return Diagnostic(
        "E0919",
        "error",
        f"`{name}` is neither an output nor a loss",
        span,
        "unknown",
        notes=(f"known: {', '.join(outputs)}",),
        help=f"did you mean `{meant}`?" if meant else None,
    )


def wrong_limit_unit(limit: str, expected: str, span: Span) -> Diagnostic:
    """E0920: a limit in a unit that the metric cannot be compared with."""
    return Diagnostic(
        "E0920",
        "error",
        f"the limit {limit} does not compare with a metric in {expected}",
        span,
        f"the metric is in {expected}",
    )


def metric_of_loss(metric: str, name: str, span: Span) -> Diagnostic:
    """E0921: a metric other than the loss itself asked of a loss."""
    return Diagnostic(
        "E0921",
        "error",
        f"`{metric}` of the loss `{name}` has no meaning: a loss is a number already",
        span,
        "this is a loss",
        help="leave `metric:` out, or name an output",
    )


def starts_elsewhere(stage: str, state: str, span: Span | None, *, of_call: bool) -> Diagnostic:
    """W0901: an initial value that holds for the first row of a record, used at other rows."""
    what = f"value with which `{state}` begins" if of_call else f"`init` of `{state}`"
    start = (
        "`skip:` of the rollout, or `init=` of an integral"
        if of_call
        else f"or an `init` that reads the log such as `{state}.meas`"
    )
    return Diagnostic(
        "W0901",
        "warning",
        f"stage `{stage}` starts rollouts inside records, where the fixed {what} need not hold",
        span,
        "reads no log",
        help=f"`rollout: record`, {start}",
    )


def at_bound(name: str, span: Span | None) -> Diagnostic:
    """W0904: a parameter that ended at a bound."""
    return Diagnostic(
        "W0904",
        "warning",
        f"`{name}` ended at its bound",
        span,
        "at the bound",
        help="the true value may lie beyond it",
    )


def attempt_left_out(number: int, attempts: int, why: Diagnostic) -> Diagnostic:
    """W0906: one of several runs of a stage that diverged while others go on."""
    return Diagnostic(
        "W0906",
        "warning",
        f"run {number} of {attempts} is left out: {why.message}",
        why.span,
        why.label,
    )


def no_native_engine(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """E0922: kernels asked for where there can be none."""
    return Diagnostic(
        "E0922",
        "error",
        f"the stage `{stage}` cannot run natively: {reason}",
        span,
        "native engine",
        help="use `engine: auto` or `engine: torch`",
    )


def torch_instead(stage: str, reason: str, span: Span | None) -> Diagnostic:
    """W0905: a stage that runs on the slower engine, and why."""
    return Diagnostic(
        "W0905",
        "warning",
        f"the stage `{stage}` runs on torch, not in native kernels: {reason}",
        span,
        "slower engine",
    )
