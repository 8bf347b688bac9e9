"""Plans a `validate` entry: names resolved, lengths in samples, limits in the metric's unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from compiler.ir.kept_results import kept_for_same
from compiler.ir.program import Output, Program
from compiler.ir.types import Prediction
from msnn.data.dataset import Dataset
from msnn.data.reading.file_sets import file_sets, set_of
from msnn.errors.learning import stages as stage_errors
from msnn.errors.learning import training as errors
from msnn.simulation.rollout_plan import RolloutPlan, default_rollout, plan_rollout, samples
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors.units import turns_or_radians
from spec_schema.expressions.tree import Expression, Member, Name, Window
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.data import Source
from spec_schema.sections.training import Metric, Validation
from spec_schema.units.parser import parse_unit
from spec_schema.units.quantity import Quantity, turn_readings
from spec_schema.units.unit import ONE, Unit

PERCENT = parse_unit("%")


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckPlan:
    """An entry of `validate` with all defaults: a metric of an output, or the value of a loss."""

    of: str
    metric: Metric | None
    """None for a loss."""
    target: Prediction | None
    rollout: RolloutPlan
    data: str | None
    """Name of the set; None for `default_set`."""
    from_files: bool
    """True if the set comes from `files:` of the entry."""
    unit: Unit | None
    """Unit of the metric or loss."""
    error_unit: Unit | None
    """Unit of the output's errors; None for a loss."""
    minimum: float | None
    maximum: float | None
    span: Span | None
    against: str = ""
    """A target such as `z[t+1]` that replaces the predicted signal; empty by default."""

    @property
    def details(self) -> tuple[str, ...]:
        """Texts about the rollouts besides horizon and closed signals, such as `skip 20`."""
        plan, starts = self.rollout, self.rollout.starts
        skip = plan.skip if starts is None else starts.skip
        stride = plan.stride if isinstance(plan.horizon, int) else plan.horizon
        told = (
            (self.against, f"against {self.against}"),
            (stride != plan.horizon, f"stride {stride}"),
            (plan.warm_up, f"warm_up {plan.warm_up}"),
            (skip > plan.warm_up, f"skip {skip}"),
            (plan.skip_rows, f"skip_rows {plan.skip_rows}"),
            (starts and starts.as_trained, "starts as trained"),
            (starts and starts.over is None and not starts.as_trained, "starts from all rows"),
        )
        return tuple(words for is_said, words in told if is_said)


def plan_checks(
    program: Program, checks: Sequence[Validation], findings: Findings
) -> list[CheckPlan]:
    """The plans of the entries; without entries, the RMSE of every prediction.

    Errors go to `findings`.
    """
    # kept with the plans, as a finding is said at each time that they are asked for
    plans, said = _plans(program, tuple(checks))
    findings.report(*said)
    return list(plans)


@kept_for_same(4)  # each set of a model is measured apart, and folds ask again
def _plans(
    program: Program, checks: tuple[Validation, ...]
) -> tuple[tuple[CheckPlan, ...], tuple[Diagnostic, ...]]:
    """The plans of entries, and their diagnostics in order."""
    if not checks:
        return _default_plans(program), ()
    findings = Findings()
    sets = file_sets(checks)
    planned = (_planned(program, check, sets, findings) for check in checks)
    plans = tuple(plan for plan in planned if plan is not None)
    return plans, findings.since(0)


def _default_plans(program: Program) -> tuple[CheckPlan, ...]:
    """The entries for a spec without `validate`: the RMSE of every output that predicts a
    signal.
    """
    default = default_rollout(program)
    return tuple(
        CheckPlan(
            of=output.name,
            metric="rmse",
            target=output.predicts,
            rollout=default,
            data=None,
            from_files=False,
            unit=_error_unit(program, output),
            error_unit=_error_unit(program, output),
            minimum=None,
            maximum=None,
            span=output.span,
        )
        for output in program.outputs
        if output.predicts is not None
    )


# rows that nothing was fitted to, where there are some
def default_set(data: Dataset) -> str:
    """The default set: `test`, else `val`, else `train`."""
    return next((name for name in ("test", "val", "train") if data.has(name)), "test")


def _planned(
    program: Program, check: Validation, sets: dict[str, Source], findings: Findings
) -> CheckPlan | None:
    outputs: Mapping[str, Output] = {output.name: output for output in program.outputs}
    losses = dict.fromkeys(n for loss in program.losses for n in (loss.entry, loss.name))
    if check.rollout is not None and check.rollout.curriculum is not None:
        findings.report(stage_errors.curriculum_outside_training(check.rollout.curriculum.span))
    rollout = plan_rollout(
        program, check.rollout, None, findings, check.skip_rows, check.place.value
    )
    # limits and metric of an entry may be wrong together: all are looked at before it is given up
    name = check.of.value
    metric: Metric | None
    target: Prediction | None = None
    unit: Unit | None
    error_unit: Unit | None = None
    if name in outputs:
        output, metric = outputs[name], check.metric
        target = output.predicts
        # `target:` in place of what the output predicts
        if check.target is not None:
            target = _target(program, check.target, findings)
        elif target is None:
            findings.report(errors.nothing_predicted(name, check.of.span))
        error_unit = _error_unit(program, output)
        unit = metric_unit(metric, error_unit)
        missing = target is None
    elif name in losses:
        metric, unit, missing = None, None, False
        if "metric" in check.model_fields_set:
            findings.report(errors.metric_of_loss(check.metric, name, check.of.span))
    else:
        findings.report(errors.unknown_output(name, check.of.span, [*outputs, *losses]))
        return None
    minimum = _limit(check.min, unit, findings)
    maximum = _limit(check.max, unit, findings)
    if rollout is None or missing:
        return None
    data = None if check.data is None else check.data.value
    if check.files is not None:
        data = set_of(check.files, sets)
    return CheckPlan(
        of=name,
        metric=metric,
        target=target,
        rollout=rollout,
        data=data,
        from_files=check.files is not None,
        unit=unit,
        error_unit=error_unit,
        minimum=minimum,
        maximum=maximum,
        span=check.place.value,
        against="" if check.target is None or target is None else _sample(target),
    )


def _sample(target: Prediction) -> str:
    return f"{target.signal}[t{target.ahead:+d}]" if target.ahead else f"{target.signal}[t]"


def _error_unit(program: Program, output: Output) -> Unit | None:
    """The unit of an output's errors: K for degC."""
    unit = program.step[output.node].type.unit
    if unit is None and output.predicts is not None:
        unit = program.signal(output.predicts.signal).unit
    return unit and unit.difference


def metric_unit(metric: Metric, unit: Unit | None) -> Unit | None:
    match metric:
        case "rmse" | "mae" | "max_abs":
            return unit
        case "fit":
            return PERCENT
        case "r2" | "fvu" | "aic":
            return ONE


def _target(program: Program, expression: Expression, findings: Findings) -> Prediction | None:
    """The recorded sample that an expression such as `x[t+1]` or `q.meas` refers to."""
    known = {signal.name for signal in program.signals}
    ahead: int | None = 0
    operand = expression
    # `x[t+1]` is the logged sample that much later; a bare name is that of now
    if isinstance(expression, Window) and expression.last is None:
        operand = expression.operand
        length = samples(expression.first.length, program.sample_time, findings)
        ahead = None if length is None else expression.first.sign * length
    match operand:
        case Name(name=name):
            # bare names are logs here, of states too (R6)
            candidates = (name, f"{name}.meas")
        case Member(base=base, name=name):
            candidates = (f"{base}.{name}", base)
        case _:
            candidates = ()
    signal = next((name for name in candidates if name in known), None)
    if signal is None:
        findings.report(errors.unscorable_target(expression.span))
    return None if signal is None or ahead is None else Prediction(signal, ahead)


def _limit(limit: Quantity | None, unit: Unit | None, findings: Findings) -> float | None:
    """The limit in the metric's unit; a number without unit is already in it."""
    if limit is None or limit.unit is None:
        return None if limit is None else limit.value
    expected = unit or ONE
    if not limit.unit.same_dimension(expected):
        findings.report(errors.wrong_limit_unit(limit.text, expected.text, limit.span))
        return None
    if (readings := turn_readings(limit.unit, expected)) is not None:
        found = turns_or_radians(limit.unit.text, expected.text, *readings.texts, limit.span)
        findings.report(found)
        return None
    # of a difference: 2 K are 2 degC
    return limit.unit.convert(limit.value, expected, is_distance=True)
