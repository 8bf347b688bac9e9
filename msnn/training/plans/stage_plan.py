"""Plans a training stage: defaults filled in, names resolved, lengths in samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Literal, assert_never

from compiler.ir.kept_results import kept_for_same
from compiler.ir.nodes import needed_over_time
from compiler.ir.program import Declared, History, LayerMemory, Program, State, Tape
from compiler.passes.draw_dropout import Mask, draw_dropout
from msnn.data.rollout_rows import reads
from msnn.errors.learning import runs, training
from msnn.errors.learning import training as errors
from msnn.model.model import is_frozen
from msnn.simulation.rollout_plan import RolloutPlan, plan_rollout
from msnn.training.plans.epochs import Phase, Rule, check_rate, plan_curriculum
from msnn.training.plans.stage_checks import (
    check_keys,
    check_losses,
    check_priors,
    concerns,
    of_parameters_alone,
    with_reached_corners,
    without_corners,
)
from msnn.training.ranks.training_ranks import TrainingRanks
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors.names import no_parameter
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.optimizers import (
    Adam,
    AdamW,
    Lbfgs,
    LevenbergMarquardt,
    OptimizerChoice,
    Sgd,
    TorchOptimizer,
)
from spec_schema.sections.training import Stage

TOTAL = "total"
"""Name of the monitor that watches the weighted total."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StagePlan:
    """A training stage of a spec, with all defaults filled in.

    A key is not inherited from the previous stage (rule R12).
    """

    index: int
    name: str
    epochs: int
    batch: int | None
    """None: all rollouts in one batch."""
    optimizer: OptimizerChoice
    lr: float | None
    """None if the optimiser has none; 1 if it is searched, as a factor of the result."""
    searches_rate: bool
    """True if the learning rate is searched before the first epoch."""
    rollout: RolloutPlan
    program: Program
    """The trained program: that of the rollout, with dropout factors as inputs."""
    masks: tuple[Mask, ...]
    """The dropout masks, which the program reads in addition to the data."""
    phases: tuple[Phase, ...]
    """Shorter horizons that are trained first."""
    loss_weights: Mapping[str, float]
    has_written_weights: bool
    """True if the stage has its own `losses:`."""
    trained: tuple[str, ...]
    """Names of the trained parameters."""
    lr_factors: Mapping[str, float]
    schedule: Rule
    clip: float | None
    weight_decay: float
    monitor: str
    patience: int | None
    seed: int
    dtype: Literal["float32", "float64"]
    engine: Literal["auto", "native", "torch"]
    device: str
    """torch's name of the device."""
    threads: int
    reproducible: bool
    """True if kernels must be bitwise reproducible even on processors where that is slow."""
    attempts: int
    """Number of runs of the stage, each from different initial values."""
    span: Span | None
    weighs_by_variance: bool = False
    """True if the weights come from `default_weights`."""
    ranks: TrainingRanks | None = None
    """The processes that share the batches; None for one process."""

    @property
    def whole_from(self) -> int:
        """The number of epochs after which the curriculum ends and rollouts have their full
        horizon.
        """
        return self.phases[-1].until if self.phases else 0

    @property
    def estimates_starts(self) -> bool:
        """True if initial states are estimated in training together with the parameters."""
        return self.rollout.starts is not None and self.optimizer.needs_squares

    @property
    def fits_starts_to_all(self) -> bool:
        """True if all scored rows determine the initial states, which then also minimise the
        total.
        """
        starts = self.rollout.starts
        return starts is not None and (self.estimates_starts or starts.over is None)

    @property
    def decay_of_total(self) -> float:
        """λ of the term λ/2 Σ raw² in the minimised total; 0 if decay is decoupled.

        Decoupled decay shrinks the values separately from the gradient. With all rollouts in one
        batch and a small rate, training ends near a minimum of the losses alone, where λ|raw| < 1
        (Xie, Li, Implicit bias of AdamW, 2024). With small batches, the minimised function is
        unknown.
        """
        match self.optimizer:
            case AdamW():
                return 0.0
            case TorchOptimizer() as optimizer:
                from msnn.training.plans.torch_optimizer_options import is_decay_decoupled

                return 0.0 if is_decay_decoupled(optimizer) else self.weight_decay
            case _:
                return self.weight_decay

    @property
    def train_skip(self) -> int:
        """Unscored steps at the beginning of training rollouts; none if initial states are
        estimated.
        """
        starts = self.rollout.starts
        return starts.skip if starts is not None and self.estimates_starts else self.rollout.skip


def with_slopes_alone(plan: StagePlan) -> StagePlan:
    """The plan for an optimiser that only takes gradient steps: its penalties are ordinary
    losses.
    """
    program = without_corners(plan.program)
    rollout = replace(plan.rollout, program=without_corners(plan.rollout.program))
    return replace(plan, program=program, rollout=rollout)


def plan_stages(program: Program, stages: Sequence[Stage], findings: Findings) -> list[StagePlan]:
    """Fills in the defaults of the stages of a spec; errors and warnings go to `findings`."""
    plans, said = _plans(program, tuple(stages))
    findings.report(*said)
    return list(plans)


@kept_for_same(4)  # folds of a model, and seeds, ask again
def _plans(
    program: Program, stages: tuple[Stage, ...]
) -> tuple[tuple[StagePlan, ...], tuple[Diagnostic, ...]]:
    """The plans of stages, and their diagnostics in order."""
    findings = Findings()
    plans = tuple(
        plan
        for index, stage in enumerate(stages)
        if (plan := _planned(program, index, stage, findings)) is not None
    )
    if not stages:
        findings.report(errors.no_stages())
    return plans, findings.since(0)


def _planned(program: Program, index: int, stage: Stage, findings: Findings) -> StagePlan | None:
    name = stage.name.value if stage.name is not None else f"stage_{index + 1}"
    span = stage.place.key
    # without a stride of the spec a run begins at every row
    rollout = plan_rollout(program, stage.rollout, 1, findings, stage.skip_rows, span)
    learned = [parameter.name for parameter in program.parameters if parameter.learn]
    for pattern in stage.freeze:
        _matching(pattern, pattern.value, learned, findings)
    factors: dict[str, float] = {}
    for pattern, factor in stage.lr.items():
        # of all that is learned: a factor of what this stage freezes is no mistake
        for parameter in _matching(factor, pattern, learned, findings):
            factors[parameter] = factor.value
    trained = tuple(parameter for parameter in learned if not is_frozen(parameter, stage))
    optimizer = stage.optimizer.choice
    if not trained:
        findings.report(errors.nothing_to_train(name, span))
    # a step of such an optimiser is one for all parameters
    if not optimizer.takes_factors and stage.lr:
        place = next(iter(stage.lr.values())).span
        findings.report(errors.no_factors_with_lbfgs(place))
    if stage.reproducible:
        _check_reproducible(name, stage, findings)
    if optimizer.needs_squares:
        check_keys(stage, findings)
    # a stage may name an entry of `losses`, or one of the losses that it is made of
    known = dict.fromkeys(n for loss in program.losses for n in (loss.entry, loss.name))
    weights = {loss.name: loss.weight * loss.share for loss in program.losses}
    # a weight of the stage replaces that of the spec; how an entry is shared out stays
    for entry, weight in stage.losses.items():
        terms = [loss for loss in program.losses if entry in (loss.name, loss.entry)]
        weights |= {term.name: weight.value * term.share for term in terms}
        if not terms:
            findings.report(errors.unknown_loss(entry, weight.key or weight.span, known))
    if rollout is not None:
        reached = with_reached_corners(rollout.program, optimizer, weights, name, findings)
        rollout = replace(rollout, program=reached)
        moved = [program.parameter(parameter) for parameter in trained]
        check_priors(reached, moved, weights, name, span, findings)
        if optimizer.needs_squares:
            check_losses(name, reached, weights, findings)
    # all weights are 0
    if not any(weights.values()):
        findings.report(errors.no_objective(name, span))
    elif rollout is not None and trained and not concerns(rollout.program, weights, trained):
        findings.report(errors.losses_of_others(name, trained, span))
    # priors without residuals are an error that says the same
    elif (
        rollout is not None
        and not findings.failed
        and of_parameters_alone(rollout.program, weights)
    ):
        predicted = [
            (out.name, out.predicts.signal, out.predicts.ahead)
            for out in program.outputs
            if out.predicts is not None
        ]
        findings.report(errors.losses_without_data(name, predicted, span))
    # epochs are compared even where none ends the stage early
    monitor, patience = TOTAL, None
    if stage.early_stop is not None:
        patience = stage.early_stop.patience
        watched = stage.early_stop.monitor
        if watched is not None:
            monitor = watched.value
            if monitor not in known and monitor != TOTAL:
                findings.report(errors.unknown_loss(monitor, watched.span, known))
    if rollout is None:
        return None
    phases: tuple[Phase, ...] = ()
    if stage.rollout is not None:
        phases = plan_curriculum(program, stage.rollout, rollout, stage.epochs, findings)
    # a batch that is written holds, also where it is the usual one
    all_at_once = optimizer.takes_all_starts and "batch" not in stage.model_fields_set
    # the layer of a parameter is what stands before its last dot
    layers = {parameter.rpartition(".")[0] for parameter in learned}
    changing = {parameter.rpartition(".")[0] for parameter in trained}
    drawn = draw_dropout(rollout.program, layers - changing - {""})
    rate = _rate(program, stage, trained, findings)
    # products of slopes have twice their digits
    dtype = "float64" if optimizer.needs_squares else stage.dtype
    check_rate(name, rate, factors, dtype, optimizer.place.key, findings)
    return StagePlan(
        index=index,
        name=name,
        epochs=stage.epochs,
        batch=None if all_at_once else stage.batch,
        optimizer=optimizer,
        lr=rate,
        searches_rate=getattr(optimizer, "lr", None) == "auto",
        rollout=rollout,
        program=drawn.program,
        masks=drawn.masks,
        phases=phases,
        loss_weights=weights,
        has_written_weights=bool(stage.losses),
        trained=trained,
        lr_factors=factors,
        schedule=None if stage.schedule is None else stage.schedule.choice,
        clip=stage.clip,
        weight_decay=stage.weight_decay,
        monitor=monitor,
        patience=patience,
        seed=stage.seed,
        dtype=dtype,
        engine="native" if stage.reproducible else stage.engine,
        # the option of the command replaces it for stages that torch trains
        device="cpu",
        threads=stage.threads,
        reproducible=stage.reproducible,
        attempts=stage.starts,
        span=span,
    )


def _rate(
    program: Program, stage: Stage, trained: Sequence[str], findings: Findings
) -> float | None:
    """The learning rate of a stage; 1 with `lr: auto`, None if the optimiser has none."""
    match stage.optimizer.choice:
        case Adam(lr=lr) | AdamW(lr=lr) | Sgd(lr=lr) | Lbfgs(lr=lr):
            return 1.0 if lr == "auto" else lr
        case TorchOptimizer() as optimizer:
            from msnn.training.plans.torch_optimizer_options import check_torch_optimizer

            moved = [program.parameter(name) for name in trained]
            return check_torch_optimizer(optimizer, stage.weight_decay, moved, findings)
        case LevenbergMarquardt():
            return None


def _check_reproducible(name: str, stage: Stage, findings: Findings) -> None:
    """Reports an optimiser whose results depend on the bits of other libraries."""
    place = stage.optimizer.choice.place.key
    match stage.optimizer.choice.steps_by:
        case "torch":
            findings.report(runs.not_reproducible(name, "its optimiser is torch's", place))
        case "LAPACK":
            reason = "levenberg_marquardt solves its equations by LAPACK"
            findings.report(runs.not_reproducible(name, reason, place))
        # kernels could repeat it, but are not asked
        case "kernel" if stage.engine == "torch":
            findings.report(runs.not_reproducible(name, "it asks for torch", stage.place.key))
        case "kernel":
            pass


def _matching(
    place: Located[str] | Located[float], pattern: str, names: Sequence[str], findings: Findings
) -> list[str]:
    found = [name for name in names if fnmatchcase(name, pattern)]
    if not found:
        span = place.key or place.span if isinstance(place.value, float) else place.span
        findings.report(no_parameter(pattern, span, names))
    return found


def fixed_starts(plan: StagePlan) -> list[Diagnostic]:
    """Warnings about states that begin each rollout with the value of a recording's first row (rule
    R7).

    A rollout inside a recording then begins with a wrong state. Exempt are states that only mean "a
    run begins" and states that only losses use: an integral in a loss starts with the rollout. The
    caller must know that rollouts start inside recordings.
    """
    program = plan.rollout.program
    following = {state.name: state.next for state in program.states}
    outputs = [output.node for output in program.outputs]
    _, deployed = needed_over_time(program.step, following, outputs)
    found: list[Diagnostic] = []
    for state in program.states:
        match state.origin:
            case Declared():
                fixed = True
            case LayerMemory(starts_fresh_each_run):
                forgotten = plan.rollout.skip > 0  # what begins wrong fades before a row counts
                fixed = not starts_fresh_each_run and state.name in deployed and not forgotten
            case History() | Tape():
                fixed = False
            case _:
                assert_never(state.origin)
        if fixed and not _reads_log(program, state):
            of_call = isinstance(state.origin, LayerMemory)
            found.append(
                training.starts_elsewhere(plan.name, state.name, state.span, of_call=of_call)
            )
    return found


def _reads_log(program: Program, state: State) -> bool:
    return bool(reads(program.start, [state.start]))
