"""Prints the metrics of a validation, and how well engines agree, as a table, JSON or JUnit XML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from msnn.errors.validation import broken_limit
from msnn.tables import Table, table_text
from msnn.validation.measurement import METRICS, UNIT_METRICS, ErrorCurve, Measurement
from msnn.validation.reports.errors_report import coverage_record, judged_record
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import MetricRow, ValidationReport
from spec_schema.diagnostics.diagnostic import Diagnostic

_METRICS_HEADER = ("of", "metric", "value", "unit", "limit", "", "rollout", "data", "scored")


def metrics_table(report: ValidationReport) -> str:
    """The metrics as a printed table; see `metrics_cells`."""
    return metrics_cells(report).text


def metrics_cells(report: ValidationReport) -> Table:
    """One row per metric: value and limits in its unit, the simulation, scored rows."""
    return Table(_METRICS_HEADER, _metric_rows(report), numbers=[2])


def metrics_markdown(name: str, report: ValidationReport) -> str:
    """The metrics as a Markdown table below a heading that says if all limits are kept."""
    verdict = "every limit is kept" if report.passed else "a limit is broken"
    return f"## {name}: {verdict}\n\n{metrics_cells(report).markdown}\n"


def broken_limits(report: ValidationReport) -> tuple[Diagnostic, ...]:
    """A diagnostic for each metric outside its limits."""
    return tuple(
        broken_limit(
            of=row.of,
            metric=row.metric,
            value=f"{row.value:.6g} {unit_text(row.unit)}".strip(),
            limit=f"{limits(row)} {unit_text(row.unit)}".strip(),
            simulated=f"{rollout_text(row)}, {row.rows}",
            data=row.data,
            scored=row.scored,
            span=row.span,
        )
        for row in report.rows
        if row.passed is False
    )


def _metric_rows(report: ValidationReport) -> list[tuple[str, ...]]:
    return [
        (
            row.of,
            row.metric,
            f"{row.value:.6g}",
            unit_text(row.unit),
            limits(row),
            _verdict(row),
            rollout_text(row),
            row.data,
            row.rows,
        )
        for row in report.rows
    ]


def measurements_table(report: ValidationReport) -> str:
    """All metrics of each output as a printed table; see `measurements_cells`."""
    return measurements_cells(report).text


def measurements_cells(report: ValidationReport) -> Table:
    """One row per output and kind of simulation: every metric of the same scored values."""
    rows = [
        (
            found.of,
            *(f"{found.metrics[metric].value:.5g}" for metric in UNIT_METRICS),
            unit_text(found.unit),
            *(f"{found.metrics[metric].value:.5g}" for metric in METRICS[len(UNIT_METRICS) :]),
            str(found.scored),
            rollout_text(found),
            found.data,
        )
        for found in report.measurements
    ]
    names = [{"fit": "fit %"}.get(metric, metric) for metric in METRICS]
    before_unit = len(UNIT_METRICS)
    header = ("of", *names[:before_unit], "unit", *names[before_unit:], "n", "rollout", "data")
    numbers = [column for column in range(1, len(METRICS) + 3) if column != before_unit + 1]
    return Table(header, rows, numbers=numbers)


def curves_table(report: ValidationReport) -> str:
    """One row per error curve at selected steps; empty if all rollouts have one step."""
    curves = [(found, found.curve) for found in report.measurements if found.curve is not None]
    if not curves:
        return ""
    readings = [_readings(curve) for _, curve in curves]
    shown = sorted({step for reading in readings for step in reading})
    rows = [
        (
            found.of,
            *(f"{reading[step]:.3g}" if step in reading else "" for step in shown),
            unit_text(found.unit),
            rollout_text(found),
            found.data,
        )
        for (found, _), reading in zip(curves, readings, strict=True)
    ]
    header = ("rmse at step", *map(str, shown), "unit", "rollout", "data")
    return table_text(header, rows, numbers=range(1, len(shown) + 1))


def metrics_record(report: ValidationReport) -> dict[str, Any]:
    """The metrics, limits and error curves of a validation as a JSON object."""
    return {
        "passed": report.passed,
        "metrics": [
            {
                "of": row.of,
                "metric": row.metric,
                "value": row.value,
                "unit": row.unit and row.unit.text,
                "elements": row.elements.tolist(),
                "min": row.minimum,
                "max": row.maximum,
                "passed": row.passed,
                "horizon": row.horizon,
                "closed": list(row.closed),
                "details": list(row.details),
                "data": row.data,
                "rows": row.rows,
                "scored": row.scored,
            }
            for row in report.rows
        ],
        "outputs": [_measurement_record(found) for found in report.measurements],
    }


def junit_text(name: str, report: ValidationReport) -> str:
    """JUnit XML with one test case per metric that has a limit."""
    limited = [row for row in report.rows if row.passed is not None]
    broken = sum(1 for row in limited if not row.passed)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<testsuite name={quoteattr(name)} tests="{len(limited)}" failures="{broken}">',
    ]
    # only what has a limit can fail: CI counts tests
    for row in limited:
        title = quoteattr(f"{row.of} {row.metric} {limits(row)} ({rollout_text(row)}, {row.data})")
        found = f"{row.value:.9g} {unit_text(row.unit)}".strip()
        lines.append(f"  <testcase classname={quoteattr(name)} name={title}>")
        if row.passed:
            lines.append(f"    <system-out>{escape(f'{found}, {row.rows}')}</system-out>")
        else:
            lines.append(f"    <failure message={quoteattr(f'{found} is not {limits(row)}')}/>")
        lines.append("  </testcase>")
    return "\n".join([*lines, "</testsuite>", ""])


def limits(row: MetricRow) -> str:
    """The limits of a metric as text: `≤ 0.002`, `0.9 … 1`."""
    match row.minimum, row.maximum:
        case None, None:
            return ""
        case None, float(high):
            return f"≤ {high:g}"
        case float(low), None:
            return f"≥ {low:g}"
        case low, high:
            return f"{low:g} … {high:g}"


def _verdict(row: MetricRow) -> str:
    return {None: "", True: "kept", False: "BROKEN"}[row.passed]


def _measurement_record(found: Measurement) -> dict[str, Any]:
    curve = found.curve
    return {
        "of": found.of,
        "unit": found.unit and found.unit.text,
        "horizon": found.horizon,
        "closed": list(found.closed),
        "details": list(found.details),
        "data": found.data,
        "rows": found.rows,
        "scored": found.scored,
        "metrics": {metric: scores.value for metric, scores in found.metrics.items()},
        "mean": {"rmse": found.mean.rmse, "of": found.mean.of},
        **judged_record(found.judged),
        **coverage_record(found.coverage),
        "curve": curve
        and {
            "first": curve.first.tolist(),
            "last": curve.last.tolist(),
            "rmse": curve.rmse.tolist(),
            "scored": curve.scored.tolist(),
        },
    }


def _readings(curve: ErrorCurve) -> dict[int, float]:
    """The error at the first step, at 1, 2, 5, 10, … and at the last step; each point once."""
    end = int(curve.last[-1])
    # at most three readings a decade, so that any curve fits in a row
    decades = [digit * 10**power for power in range(len(str(end))) for digit in (1, 2, 5)]
    step_of: dict[int, int] = {}
    begin = int(curve.first[0])
    for step in (begin, *(k for k in decades if begin < k < end), end):
        (points,) = np.nonzero((curve.first <= step) & (step <= curve.last))
        for point in points.tolist():
            step_of.setdefault(point, step)
    return {step: float(curve.rmse[point]) for point, step in step_of.items()}


JUDGE = "interpreter"


@dataclass(frozen=True, slots=True)
class EnginesReport:
    """The validation by every available engine, to compare engines."""

    reports: Mapping[str, ValidationReport]
    left_out: Mapping[str, str]
    """Reasons for missing engines, by name."""

    @property
    def judged(self) -> ValidationReport:
        """The results of the reference interpreter, which decide limits."""
        return self.reports[JUDGE]


def engines_table(report: EnginesReport) -> str:
    """One row per metric: the interpreter's value, and each engine's relative difference."""
    others = [name for name in report.reports if name != JUDGE]
    rows: list[tuple[str, ...]] = []
    for place, row in enumerate(report.judged.rows):
        values = (report.reports[name].rows[place].value for name in others)
        differences = [difference_text(value, row.value) for value in values]
        about = (rollout_text(row), row.data)
        rows.append(
            (row.of, row.metric, *about, f"{row.value:.6g}", unit_text(row.unit), *differences)
        )
    header = ("of", "metric", "rollout", "data", JUDGE, "unit", *others)
    return table_text(header, rows, numbers=[4, *range(6, len(header))])


def engines_record(report: EnginesReport) -> dict[str, Any]:
    """The complete report of each engine as JSON values."""
    return {
        "passed": report.judged.passed,
        "engines": {name: metrics_record(found) for name, found in report.reports.items()},
        "left_out": dict(report.left_out),
    }


def difference_text(value: float, judged: float) -> str:
    """The difference of `value` and `judged` relative to the latter; "0" if both are NaN."""
    # NaN differs from everything, also from itself
    if value == judged or (math.isnan(value) and math.isnan(judged)):
        return "0"
    return f"{abs(value - judged) / abs(judged):.1e}" if judged else f"{abs(value):.1e} (of 0)"
