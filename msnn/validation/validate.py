"""Measures a trained program on data, and compares what is found with the limits of the spec."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.liveness import Extent
from compiler.ir.program import Program, learned_numbers
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.data.scored import rows_that_count
from msnn.data.starts import Runs
from msnn.simulation.rollout import LossSum, entry_value, loss_sums, moments
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.simulation.row_factors import check_row_factors
from msnn.simulation.start_fit import with_starts
from msnn.validation.measurement import Measurement, error_curve, error_trace, scores_of
from msnn.validation.plan import CheckPlan, default_set, plan_checks
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.sections.validation import Validation
from spec_schema.units.unit import Unit

Weights = Mapping[str, FloatArray]
_SIDE_BY_SIDE = 4096
"""Rollouts that run at once; bounds the memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricRow:
    """One metric: what was measured on which rows, the value, and whether it keeps its limits."""

    of: str
    metric: str
    """`rmse`, …, or `loss`."""
    value: float
    unit: Unit | None
    elements: FloatArray
    """The metric of each element of a vector output; shape () for a scalar."""
    horizon: str
    closed: tuple[str, ...]
    data: str
    rows: str
    """Which rows were scored: `rows 5…1023 of 1024`, or their number in several records."""
    scored: int
    minimum: float | None
    maximum: float | None
    span: Span | None

    @property
    def passed(self) -> bool | None:
        """Whether the value keeps its limits; None without limits. NaN keeps none."""
        if self.minimum is None and self.maximum is None:
            return None
        low = self.minimum is None or self.value >= self.minimum
        return low and (self.maximum is None or self.value <= self.maximum)


@dataclass(frozen=True, slots=True)
class ValidationReport:
    """What a spec asks to be measured, in its order."""

    rows: tuple[MetricRow, ...]
    """The metrics of its entries."""
    measurements: tuple[Measurement, ...]
    """Every metric of each output and way to simulate it that an entry names."""
    warnings: tuple[Diagnostic, ...]

    @property
    def passed(self) -> bool:
        """Whether no limit is broken."""
        return all(row.passed is not False for row in self.rows)


def validate(
    program: Program,
    data: Dataset | None,
    checks: Sequence[Validation],
    weights: Weights | None = None,
    *,
    on: str | None = None,
    files: Mapping[str, Dataset] | None = None,
) -> ValidationReport:
    """Measures every entry of the `validate` section with the interpreter in float64.

    `on` is a set to measure all of them on, whatever set or files they name; `files` are the data
    of entries with files, by set. `data` may be None where every entry has files. Rollouts start a
    horizon apart, so that each row is scored once; a last shorter one covers the rest. Raises
    SpecError where an entry and the data do not fit.
    """
    findings = Findings()
    plans = plan_checks(program, checks, findings)
    ready: list[tuple[CheckPlan, str, Runs, Dataset]] = []
    for plan in plans:
        measured = (files or {})[plan.data] if plan.from_files and plan.data and not on else data
        assert measured is not None, "only entries with files do without data"
        name = on or plan.data or default_set(measured)
        wanted_by = f"the metric of `{plan.of}`"
        stride = None if plan.rollout.stride == plan.rollout.horizon else plan.rollout.stride
        ahead = plan.target.ahead if plan.target is not None else 0
        also = Extent(min(ahead, 0), max(ahead, 0))
        runs = set_rollouts(
            plan.rollout, measured, name, stride, wanted_by, plan.span, findings, also
        )
        if runs is not None and plan.metric is None:
            counted = counted_rows(plan.rollout, measured, name)
            check_row_factors(plan.rollout.program, measured, runs, counted, findings)
        if runs is not None and not findings.failed:
            measured = with_starts(plan.rollout, measured, runs, weights, wanted_by, findings)
            ready.append((plan, name, runs, measured))
    findings.raise_errors()
    rows: list[MetricRow] = []
    found: dict[object, Measurement] = {}
    for plan, name, runs, measured in ready:
        if plan.metric is None:
            rows.append(_loss_row(plan, name, runs, measured, weights))
            continue
        rollout = plan.rollout  # entries that differ in metric and limits only are one simulation
        way = (plan.of, plan.target, name, rollout.horizon, rollout.stride, rollout.skip)
        key = (*way, rollout.closed, rollout.warm_up, rollout.skip_rows, plan.from_files)
        if key not in found:
            found[key] = _measurement(plan, name, runs, measured, weights)
        rows.append(_row(plan, found[key]))
    return ValidationReport(tuple(rows), tuple(found.values()), findings.in_order)


def _loss_row(
    plan: CheckPlan, name: str, runs: Runs, data: Dataset, weights: Weights | None
) -> MetricRow:
    judge = Interpreter(plan.rollout.program, weights)
    value, count = _loss(plan, judge, name, runs, data)
    return MetricRow(
        of=plan.of,
        metric="loss",
        value=value,
        unit=plan.unit,
        elements=np.array(value),
        horizon=str(plan.rollout.horizon),
        closed=plan.rollout.closed,
        data=name,
        rows=f"{count:.6g} values",
        scored=round(count),
        minimum=plan.minimum,
        maximum=plan.maximum,
        span=plan.span,
    )


def _row(plan: CheckPlan, found: Measurement) -> MetricRow:
    assert plan.metric is not None
    scores = found.metrics[plan.metric]
    return MetricRow(
        of=plan.of,
        metric=plan.metric,
        value=scores.value,
        unit=plan.unit,
        elements=scores.elements,
        horizon=found.horizon,
        closed=found.closed,
        data=found.data,
        rows=found.rows,
        scored=scores.count,
        minimum=plan.minimum,
        maximum=plan.maximum,
        span=plan.span,
    )


def _measurement(
    plan: CheckPlan, name: str, runs: Runs, data: Dataset, weights: Weights | None
) -> Measurement:
    judge = Interpreter(plan.rollout.program, weights)
    prediction, target, rows, number = _predictions(plan, judge, name, runs, data)
    metrics = scores_of(prediction, target, learned_numbers(plan.rollout.program))
    return Measurement(
        of=plan.of,
        unit=plan.output_unit,
        horizon=str(plan.rollout.horizon),
        closed=plan.rollout.closed,
        data=name,
        rows=_rows_text(data, rows),
        scored=metrics["rmse"].count,
        metrics=metrics,
        curve=error_curve(prediction, target, number, few=isinstance(plan.rollout.horizon, str)),
        trace=error_trace(prediction, target),
    )


def _loss(
    plan: CheckPlan, judge: Interpreter, name: str, runs: Runs, data: Dataset
) -> tuple[float, float]:
    program = plan.rollout.program
    rows = counted_rows(plan.rollout, data, name)
    terms = [loss for loss in program.losses if plan.of in (loss.name, loss.entry)]
    totals = {term.name: LossSum(0.0, 0) for term in terms}
    for part in _parts(runs):
        sums = loss_sums(judge, data.series, part, plan.rollout.skip, rows)
        totals = {name: total + sums[name] for name, total in totals.items()}
    values = {term.name: totals[term.name].value(term.measure) for term in terms}
    return entry_value(program, plan.of, values), max(t.count for t in totals.values())


def _predictions(
    plan: CheckPlan, judge: Interpreter, name: str, runs: Runs, data: Dataset
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Predictions and targets, (samples, *shape), the targets' rows, in whose order they are, and
    each one's number within its rollout."""
    assert plan.target is not None
    ahead = plan.target.ahead
    whole = plan.rollout.horizon == "record"
    counting = rows_that_count(
        data, name if whole else None, Extent(ahead, ahead), plan.rollout.skip_rows
    )
    found: list[FloatArray] = []
    times: list[IntArray] = []
    numbers: list[IntArray] = []
    for part in _parts(runs):
        for moment in moments(judge, data.series, part, losses=False):
            if moment.number < plan.rollout.skip:
                continue
            counts = counting[moment.t]
            found.append(moment.values.outputs[plan.of][counts])
            times.append(moment.t[counts])
            numbers.append(np.full(len(times[-1]), moment.number))
    t = np.concatenate(times)
    order = np.argsort(t, kind="stable")
    prediction, rows = np.concatenate(found)[order], t[order] + ahead
    target = data.series[plan.target.signal][rows]
    return prediction, target, rows, np.concatenate(numbers)[order]


def _parts(runs: Runs) -> list[Runs]:
    starts = range(0, len(runs), _SIDE_BY_SIDE)
    return [runs.take(np.arange(s, min(s + _SIDE_BY_SIDE, len(runs)))) for s in starts]


def _rows_text(data: Dataset, rows: IntArray) -> str:
    """Which rows were scored, so that off-by-ones between tools are visible."""
    if not len(rows):
        return "no rows"
    rows = np.unique(rows)  # rollouts that overlap score a row more than once
    touched = [r for r in data.records if np.any((rows >= r.start) & (rows < r.stop))]
    if len(touched) > 1:
        total = sum(record.stop - record.start for record in touched)
        return f"{len(rows)} of {total} rows in {len(touched)} records"
    record = touched[0]
    first, last = int(rows[0]) - record.start, int(rows[-1]) - record.start
    total = record.stop - record.start
    if len(rows) == last - first + 1:
        return f"rows {first}…{last} of {total}"
    return f"{len(rows)} of rows {first}…{last} of {total}"
