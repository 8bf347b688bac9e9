"""Shows how well engines agree on a validation, as a table or JSON values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msnn.tables import table_text
from msnn.validation.reports.report import metrics_record
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import ValidationReport

JUDGE = "interpreter"


@dataclass(frozen=True, slots=True)
class EnginesReport:
    """The results of every available engine."""

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
