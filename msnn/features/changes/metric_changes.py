"""Compares the metrics of two validations, and finds those that became worse."""

from __future__ import annotations

import math
from dataclasses import dataclass

from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import MetricRow, ValidationReport
from spec_schema.diagnostics.source import Span

_BEST = {"fit": 100.0, "r2": 1.0}
"""Best values of metrics that increase with accuracy; the error is the distance from them."""
_UNJUDGED = ("aic",)
"""Metrics without a meaningful ratio: `aic` includes the number of parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """One metric of both models with equal evaluation; None if one model lacks it."""

    of: str
    metric: str
    unit: str
    rollout: str
    data: str
    old: float | None
    new: float | None
    growth: float | None
    """Relative increase of the error, 0.1 for a tenth; None if undefined."""
    note: str
    """The reason for an undefined increase, or further differences."""
    span: Span | None
    """Place of the entry in the new spec."""


def metric_changes(old: ValidationReport, new: ValidationReport) -> tuple[MetricChange, ...]:
    """Every metric of either spec, in the order of the new one."""
    before, after = _by_meaning(old), _by_meaning(new)
    return tuple(
        # the new one's order, then what only the old one measures
        _change(before.get(meaning), after.get(meaning))
        for meaning in {**after, **before}
    )


def error_growth(metric: str, old: float, new: float) -> float | None:
    """The relative increase of the error of a metric; NaN if infinite.

    For rmse, mae, max_abs, fvu and losses the error is the value; for `fit` and `r2` it is the
    distance from 100 % and 1. None for `aic`.
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
