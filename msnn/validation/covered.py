"""Measures the coverage of prediction intervals, in the rollouts of each entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning.weights import no_training_rows, nothing_to_band
from msnn.model.weights.covariance import Covariance
from msnn.simulation.engines.engine import Advance, Engine
from msnn.simulation.engines.open_rollouts import open_rollouts
from msnn.simulation.intervals import Intervals, uncertain_program
from msnn.simulation.rollout_plan import free_rollout
from msnn.validation.judged_errors import TRAINED_ON
from msnn.validation.measurement import Measurement
from msnn.validation.outcomes import (
    Simulator,
    reduced,
    rollout_parts,
    simulated_together,
)
from msnn.validation.plan import CheckPlan, plan_checks
from msnn.validation.ready_check import Counted, ReadyCheck, ready_check, with_found_starts
from msnn.validation.statistics.coverage import LEVELS, Counts, Coverage
from spec_schema.diagnostics.diagnostic import Findings, SpecError

Weights = Mapping[str, FloatArray]

# memory is bounded by what is simulated at once, not by the data
_STEPS = 1 << 20
"""Number of steps that are simulated before they are counted."""


def residual_variances(
    plans: Sequence[CheckPlan],
    data: Dataset | None,
    weights: Weights,
    covariance: Covariance,
    engine: Engine,
) -> list[FloatArray]:
    """Residual variance σ² of each plan's rollouts over the training rows, per element.

    The divisor is n − p for n values and p learned parameters. Raises SpecError if there are no
    training rows.
    """
    findings = Findings()
    twins: list[ReadyCheck] = []
    for plan in plans:
        # intervals rest on the errors of the rows that were fitted
        if data is None or TRAINED_ON not in data.sets or not data.has(TRAINED_ON):
            findings.report(no_training_rows(plan.of, f"the data have no set `{TRAINED_ON}`"))
            break
        there = replace(plan, data=TRAINED_ON, from_files=False)
        twin = ready_check(there, data, TRAINED_ON, {}, findings)
        if twin is not None:
            twins.append(twin)
    findings.raise_errors()
    twins = with_found_starts(twins, weights, findings)
    found: list[FloatArray] = []
    for outcome in Simulator(engine, weights, lambda _: None).outcomes(twins):
        assert isinstance(outcome, Measurement), "losses have no interval"
        # one variance for all steps of a rollout: a p is taken off as in a regression
        scores = outcome.metrics["rmse"]
        freedom = scores.count - covariance.free
        if freedom <= 0:
            why = f"{covariance.free} numbers were learned from {scores.count} values"
            raise SpecError([no_training_rows(outcome.of, why)])
        found.append(scores.elements**2 * scores.count / freedom)
    return found


def free_intervals(
    program: Program,
    data: Dataset,
    weights: Weights,
    covariance: Covariance,
    level: float,
    engine: Engine,
) -> Intervals:
    """The prediction intervals of a simulation of whole recordings, for every predicting output."""
    rollout = free_rollout(program)
    plans = [replace(plan, rollout=rollout) for plan in plan_checks(program, (), Findings())]
    if not plans:
        raise SpecError([nothing_to_band([output.name for output in program.outputs])])
    variances = residual_variances(plans, data, weights, covariance, engine)
    noise = {plan.of: variance for plan, variance in zip(plans, variances, strict=True)}
    return Intervals(level=level, covariance=covariance, noise=noise)


def coverages(
    checks: Sequence[ReadyCheck],
    measured: Sequence[Measurement],
    variances: Sequence[FloatArray],
    *,
    weights: Weights,
    covariance: Covariance,
    engine: Engine,
    advance: Advance,
) -> list[Coverage]:
    """The fraction of measured values inside prediction intervals, for each entry; none may be a
    loss.
    """
    found: dict[int, Coverage] = {}
    for group in simulated_together(checks):
        first, names = checks[group[0]], {checks[index].plan.of for index in group}
        # variances cost a direction for each learned number: other outputs go without them
        program = reduced(
            first.plan.rollout.program, lambda output, of=names: output.name in of, lambda _: False
        )
        noise = {checks[index].plan.of: variances[index] for index in group}
        spread = uncertain_program(
            program,
            Intervals(level=LEVELS[-1], covariance=covariance, noise=noise),
            weights,
        )
        opened = open_rollouts(engine, spread.program, spread.weights, first.series, first.runs)
        counts = {index: Counts(variances[index]) for index in group}
        targets = {index: _target(checks[index]) for index in group}
        for part in rollout_parts(first.runs, _STEPS):
            outputs = opened.engine.outputs(part, advance)
            for index, count in counts.items():
                counting, of = Counted(checks[index]).among(part), checks[index].plan.of
                count.add(
                    outputs[of][counting.steps],
                    spread.variance(of, outputs)[counting.steps],
                    targets[index][counting.rows],
                )
        for index, count in counts.items():
            residuals = measured[index].judged.residuals
            found[index] = count.coverage(
                each.itself.values for each in residuals if each.itself is not None
            )
    return [found[index] for index in range(len(checks))]


def _target(check: ReadyCheck) -> FloatArray:
    """The measurements that an entry compares with."""
    assert check.plan.target is not None, "entries that are losses have no intervals"
    return check.data.measured_values(check.plan.target.signal)
