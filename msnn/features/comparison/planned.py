"""Determines what a comparison will measure of a model, before training."""

from __future__ import annotations

import math
from dataclasses import dataclass

from msnn.model.model import Model
from msnn.training.records.run_log import Measured
from msnn.validation.measurement import METRICS
from msnn.validation.plan import CheckPlan, plan_checks
from msnn.validation.reports.words import rollout_text, unit_text
from spec_schema.diagnostics.diagnostic import Findings


def planned(model: Model) -> tuple[Measured, ...]:
    """The metrics of the `validate` section with unknown values. Raises SpecError."""
    findings = Findings()
    plans = plan_checks(model.program, model.spec.checks, findings)
    findings.raise_errors()
    return tuple(_planned(plan) for plan in plans)


@dataclass(frozen=True, slots=True)
class _Simulated:
    horizon: str
    closed: tuple[str, ...]
    details: tuple[str, ...]


def _planned(plan: CheckPlan) -> Measured:
    names: tuple[str, ...] = ("loss",) if plan.metric is None else METRICS
    how = _Simulated(str(plan.rollout.horizon), plan.rollout.closed, plan.details)
    return Measured(
        of=plan.of,
        unit=unit_text(plan.unit),
        rollout=rollout_text(how),
        scored=0,
        asked="loss" if plan.metric is None else plan.metric,
        # what will be known is which numbers there are: criteria are looked up by name
        metrics=dict.fromkeys(names, math.nan),
    )
