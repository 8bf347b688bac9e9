"""Compares what validations of two models have measured, and says what became worse."""

from __future__ import annotations

import math
from dataclasses import dataclass

from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import MetricRow, ValidationReport
from spec_schema.diagnostics.source import Span

_BEST = {"fit": 100.0, "r2": 1.0}
"""Of metrics that grow with the model; what they lack of it counts as the error."""
_UNJUDGED = ("aic",)
"""Counts parameters too: a difference, and no ratio, has a meaning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """One metric of both models, measured alike; None where one of them does not measure it."""

    of: str
    metric: str
    unit: str
    rollout: str
    data: str
    old: float | None
    new: float | None
    growth: float | None
    """By how much the error grew, 0.1 for a tenth; None where that cannot be said."""
    note: str
    """Why that cannot be said, or what else differs."""
    span: Span | None
    """Of the entry in the new spec."""


def metric_changes(old: ValidationReport, new: ValidationReport) -> tuple[MetricChange, ...]:
    """Every metric that either spec asks for, in the order of the new one."""
    before, after = _by_meaning(old), _by_meaning(new)
    return tuple(
        # the new one's order, then what only the old one measures
        _change(before.get(meaning), after.get(meaning))
        for meaning in {**after, **before}
    )


def error_growth(metric: str, old: float, new: float) -> float | None:
    """By how much the error behind a metric grew, as a share of the former; NaN is endless.

    Of rmse, mae, max_abs, fvu and losses the error is the value, of `fit` and `r2` what they lack
    of 100 % and of 1. None for `aic`.
    """
    if metric in _UNJUDGED:
        return None
    best = _BEST.get(metric)
    errors = (old, new) if best is None else (best - old, best - new)
    before, after = (math.inf if math.isnan(error) else error for error in errors)
    if before == after:
        return 0.0
    if before == 0.0 or math.isinf(before):  # no share of it is a number
        return math.copysign(1.0 if before else math.inf, after - before)
    return (after - before) / abs(before)


def _by_meaning(report: ValidationReport) -> dict[tuple[str, ...], MetricRow]:
    return {(row.of, row.metric, rollout_text(row), row.data): row for row in report.rows}


def _change(old: MetricRow | None, new: MetricRow | None) -> MetricChange:
    row = new or old
    assert row is not None
    growth, note = None, ""
    if old is None or new is None:
        note = "only in the new spec" if old is None else "only in the old spec"
    # not converted: a unit of a target that changed may be a mistake
    elif old.unit != new.unit:
        note = f"in {unit_text(old.unit) or '1'} before"
    else:
        growth = error_growth(new.metric, old.value, new.value)
        note = "" if old.scored == new.scored else f"{old.scored} values before, {new.scored} now"
    return MetricChange(
        of=row.of,
        metric=row.metric,
        unit=unit_text(row.unit),
        rollout=rollout_text(row),
        data=row.data,
        old=None if old is None else old.value,
        new=None if new is None else new.value,
        growth=growth,
        note=note,
        span=None if new is None else new.span,
    )
