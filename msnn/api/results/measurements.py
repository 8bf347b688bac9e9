"""Shows evaluations: metrics of a validation, simulations next to measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from compiler.ir.program import Program
from msnn.api.results.shown import Shown
from msnn.reports.pictures.simulation import plot_simulation
from msnn.reports.pictures.validation import plot_validation
from msnn.simulation.simulate import Simulations
from msnn.simulation.table import run_record, simulation_rows
from msnn.tables import Table, count
from msnn.validation.measurement import METRICS
from msnn.validation.reports.report import limits, measurements_cells, metrics_cells
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import ValidationReport


@dataclass(frozen=True, slots=True, repr=False)
class ShownReport(Shown, ValidationReport):
    """A validation with its tables; `to_frame` has one row per output, simulation and metric."""

    def _said(self) -> str:
        broken = sum(1 for row in self.rows if row.passed is False)
        limited = sum(1 for row in self.rows if row.passed is not None)
        kept = f"{broken} of {count(limited, 'limit')} not kept" if limited else "no limits"
        return f"ValidationReport: {count(len(self.measurements), 'measurement')}, {kept}"

    def _tables(self) -> Sequence[Table]:
        return [metrics_cells(self), measurements_cells(self)]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        limit = {
            (row.of, row.metric, rollout_text(row), row.data): limits(row) for row in self.rows
        }
        found = [
            (
                each.of,
                metric,
                each.metrics[metric].value,
                unit_text(each.unit) if metric in METRICS[:3] else "",
                limit.get((each.of, metric, rollout_text(each), each.data), ""),
                rollout_text(each),
                each.data,
                each.scored,
            )
            for each in self.measurements
            for metric in METRICS
        ]
        found += [
            (
                row.of,
                row.metric,
                row.value,
                unit_text(row.unit),
                limits(row),
                rollout_text(row),
                row.data,
                row.scored,
            )
            for row in self.rows
            if row.metric not in METRICS
        ]
        names = ("of", "metric", "value", "unit", "limit", "rollout", "data", "scored")
        return {name: [row[i] for row in found] for i, name in enumerate(names)}

    def _draw(self, path: Path) -> Path:
        return plot_validation(path, self)


@dataclass(frozen=True, slots=True, repr=False)
class ShownSimulations(Shown, Simulations):
    """Simulations; `to_frame` is the table of `msnn simulate`, one row per step."""

    program: Program | None = None
    """The simulated program."""

    def _said(self) -> str:
        steps = sum(run.steps for run in self.runs)
        return f"Simulations: {count(len(self.runs), 'run')}, {count(steps, 'step')}"

    def _ran(self) -> Program:
        assert self.program is not None, "simulate gives it"
        return self.program

    def _tables(self) -> Sequence[Table]:
        rows = [
            (
                ", ".join(dict.fromkeys(run.places.files)),
                ", ".join(name or "no set" for name in dict.fromkeys(run.places.sets)),
                str(run.steps),
                _ends(run_record(run)["rows"]),
                _ends(run_record(run)["time"]),
            )
            for run in self.runs
        ]
        return [Table(("file", "set", "steps", "rows", "time / s"), rows, [2])]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        header, rows = simulation_rows(self._ran(), self.runs)
        columns = list(zip(*rows, strict=True)) or [() for _ in header]
        return {
            # "" is what a file has where there is no number
            name: list(column) if name in ("file", "set") else [_number(cell) for cell in column]
            for name, column in zip(header, columns, strict=True)
        }

    def _draw(self, path: Path) -> Path:
        return plot_simulation(path, self._ran(), self.runs)


def _number(cell: object) -> object:
    return None if cell == "" else cell


def _ends(found: object) -> str:
    if not isinstance(found, list):
        return ""
    ends = cast("list[float | None]", found)
    return " … ".join("–" if end is None else f"{end:g}" for end in ends)
