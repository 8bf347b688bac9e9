"""Evaluates a trained program on data, and checks the limits of the spec."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.validation import Outside, extrapolates, worse_than_mean
from msnn.model.model import learned_numbers
from msnn.model.weights.covariance import Covariance
from msnn.model.weights.kept_starts import KeptStarts
from msnn.simulation.engines.engine import Count, Engine, RolloutProgress, nobody
from msnn.validation.covered import coverages, residual_variances
from msnn.validation.measurement import Measurement
from msnn.validation.outcomes import LossValue, Outcome, Simulator, simulated_together
from msnn.validation.plan import plan_checks
from msnn.validation.ready_check import ReadyCheck, ready_check, with_found_starts
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.sections.training import Stage, Validation
from spec_schema.units.unit import ONE, Unit

Weights = Mapping[str, FloatArray]
_TOLD = 0.01
"""Minimum fraction of scored rows outside the training range for a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricRow:
    """One metric: the scored rows, the value, and the verdict about its limits."""

    of: str
    metric: str
    """`rmse`, …, or `loss`."""
    value: float
    unit: Unit | None
    elements: FloatArray
    """The metric of each element of a vector output; shape () for a scalar."""
    horizon: str
    closed: tuple[str, ...]
    details: tuple[str, ...]
    """Further properties of the evaluation: `skip 20`, `against z[t]`."""
    data: str
    rows: str
    """The scored rows as text: `rows 5…1023 of 1024`, or counts for several recordings."""
    scored: int
    minimum: float | None
    maximum: float | None
    span: Span | None

    @property
    def passed(self) -> bool | None:
        """True if the value is within its limits; None without limits. NaN is outside."""
        if self.minimum is None and self.maximum is None:
            return None
        low = self.minimum is None or self.value >= self.minimum
        return low and (self.maximum is None or self.value <= self.maximum)


@dataclass(frozen=True, slots=True)
class ValidationReport:
    """The results of the `validate` section, in its order."""

    rows: tuple[MetricRow, ...]
    """The metrics of the entries."""
    measurements: tuple[Measurement, ...]
    """All metrics of each output and kind of simulation in the entries."""
    warnings: tuple[Diagnostic, ...]

    @property
    def passed(self) -> bool:
        """True if all values are within their limits."""
        return all(row.passed is not False for row in self.rows)


def validate(
    program: Program,
    data: Dataset | None,
    checks: Sequence[Validation],
    weights: Weights | None = None,
    *,
    on: str | None = None,
    files: Mapping[str, Dataset] | None = None,
    engine: Engine = "auto",
    progress: RolloutProgress = nobody,
    covariance: Covariance | None = None,
    judges_errors: bool = True,
    stages: Sequence[Stage] = (),
    kept: KeptStarts | None = None,
) -> ValidationReport:
    """Evaluates every entry of the `validate` section in float64.

    `on` replaces the set or files of all entries by one set; `files` maps sets of entries with
    files to their data. `data` may be None if every entry has files. Rollouts start one horizon
    apart, so that each row is scored once; a last, shorter one covers the rest.

    `engine` selects the simulation (`open_rollouts`). A limit within the possible difference
    between engines is checked with the reference interpreter. A `covariance` of the parameters adds
    the coverage of prediction intervals. Without `judges_errors`, there are no correlations of
    errors and no warnings about inputs outside the training range.

    `stages` are the training stages, whose trained parameters `aic` counts. `kept` are saved
    initial states of the training. Raises SpecError if an entry and the data do not fit.
    """
    findings = Findings()
    plans = plan_checks(program, checks, findings)
    tried = [ready_check(plan, data, on, files or {}, findings) for plan in plans]
    ready = [check for check in tried if check is not None]
    findings.raise_errors()
    # where rollouts start is part of the question: all engines get the same starts
    ready = with_found_starts(ready, weights, findings, kept)
    banded = [] if covariance is None else _measured_apart(ready)
    steps = _steps(ready) + _steps(banded)
    count = Count(progress, steps)
    simulator = Simulator(
        engine,
        weights or {},
        count.advance,
        judges=judges_errors,
        learned=learned_numbers(program, stages),
    )
    outcomes = simulator.outcomes(ready)
    # by identity: entries measured alike share one measurement
    measurements = {id(found): found for found in outcomes if isinstance(found, Measurement)}
    # of each measurement, so that a signal that several entries read may come more than once
    far: dict[str, dict[str, Outside]] = {}
    for found in measurements.values():
        for each in found.judged.extrapolations:
            one = Outside(each.signal, each.share, each.low, each.high)
            before = far.setdefault(found.data, {}).get(each.signal)
            if each.share >= _TOLD and (before is None or before.share < each.share):
                far[found.data][each.signal] = one
    measured = tuple(measurements.values())
    if covariance is not None:
        known = weights or {}
        variances = residual_variances(
            [check.plan for check in banded], data, known, covariance, engine
        )
        found = coverages(
            banded,
            measured,
            variances,
            weights=known,
            covariance=covariance,
            engine=engine,
            advance=count.advance,
        )
        pairs = zip(measured, found, strict=True)
        measured = tuple(replace(each, coverage=coverage) for each, coverage in pairs)
    return ValidationReport(
        tuple(_row(check, found) for check, found in zip(ready, outcomes, strict=True)),
        measured,
        (
            *findings.in_order,
            *simulator.notes,
            *(extrapolates(name, tuple(each.values())) for name, each in far.items() if each),
            *(_worse_than_mean(measured) if judges_errors else ()),
        ),
    )


def _worse_than_mean(measured: Sequence[Measurement]) -> Iterator[Diagnostic]:
    """W0842 for each output with larger errors than a constant, of the simulation with the worst
    ratio.
    """
    worst: dict[str, Measurement] = {}
    for found in measured:
        before = worst.get(found.of)
        if found.times_mean > 1 and (before is None or found.times_mean > before.times_mean):
            worst[found.of] = found
    for found in worst.values():
        unit = "" if found.unit is None or found.unit == ONE else f" {found.unit.text}"
        steps = found.horizon if found.horizon.isdecimal() else f"`{found.horizon}`"
        yield worse_than_mean(
            of=found.of,
            rmse=f"{found.metrics['rmse'].value:.4g}{unit}",
            mean=f"{found.mean.rmse:.4g}{unit}",
            rows=found.mean.of,
            simulated=f"rollout {steps}, set `{found.data}`",
        )


def _measured_apart(checks: Sequence[ReadyCheck]) -> list[ReadyCheck]:
    """One of the entries for each different evaluation, in order; entries that are losses are
    omitted.
    """
    found: list[ReadyCheck] = []
    for check in checks:
        if check.plan.metric is not None and not any(map(check.is_measured_as, found)):
            found.append(check)
    return found


def _steps(checks: Sequence[ReadyCheck]) -> int:
    return sum(int(checks[group[0]].runs.steps.sum()) for group in simulated_together(checks))


def _row(check: ReadyCheck, found: Outcome) -> MetricRow:
    plan = check.plan
    if isinstance(found, LossValue):
        metric, value, elements = "loss", found.value, np.array(found.value)
        rows, scored = f"{found.scored:.6g} values", round(found.scored)
        # what is counted is no number of values then
        terms = (t for t in plan.rollout.program.losses if plan.of in (t.name, t.entry))
        if any(term.rows is not None for term in terms):
            rows += ", each by its factor"
    else:
        assert plan.metric is not None
        metric, scores, rows = plan.metric, found.metrics[plan.metric], found.rows
        value, elements, scored = scores.value, scores.elements, scores.count
    return MetricRow(
        of=plan.of,
        metric=metric,
        value=value,
        unit=plan.unit,
        elements=elements,
        horizon=str(plan.rollout.horizon),
        closed=plan.rollout.closed,
        details=plan.details,
        data=check.name,
        rows=rows,
        scored=scored,
        minimum=plan.minimum,
        maximum=plan.maximum,
        span=plan.span,
    )
