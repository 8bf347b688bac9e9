"""Shows trainings: parameters, results of stages, losses over epochs, folds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from msnn.api.results.shown import Shown
from msnn.model.model import Model
from msnn.reports.functions_of_run import functions_of_run
from msnn.reports.learned_functions import learned_functions
from msnn.reports.pictures.run import plot_run
from msnn.reports.run_summary import read_run
from msnn.reports.training_summary import Recorded, parameters_cells, stages_cells
from msnn.tables import Table, count
from msnn.training.folds import FoldsResult, folds_cells, folds_record
from msnn.training.records.learned.parameters_record import parameters_record
from msnn.training.training_result import TrainingResult


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ShownTraining(Shown, TrainingResult):
    """A training with its tables; `to_frame` has one row per element of every parameter."""

    model: Model
    recorded: Recorded

    def _said(self) -> str:
        stages = count(len(self.stages), "stage")
        best = f", best {self.stages[-1].best_value:.6g}" if self.stages else ""
        kept = "kept nowhere" if self.folder is None else f"kept in {self.folder}"
        return f"TrainingResult: {stages}{best}, {kept}"

    def _record(self) -> dict[str, Any]:
        return parameters_record(self.model.program, self.weights, self.standard_errors)

    def _tables(self) -> Sequence[Table]:
        return [stages_cells(self.recorded.stages), parameters_cells(self._record())]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        found = [
            (
                each["name"],
                ",".join(map(str, np.unravel_index(k, each["shape"]))) if each["shape"] else "",
                each["unit"] or "",
                each["initial"][k],
                value,
                None if each["standard_errors"] is None else each["standard_errors"][k],
                each["learn"],
            )
            for each in self._record()["parameters"]
            for k, value in enumerate(each["values"])
        ]
        names = ("parameter", "index", "unit", "initial", "learned", "std_error", "learn")
        return {name: [row[i] for row in found] for i, name in enumerate(names)}

    def _draw(self, path: Path) -> Path:
        return _drawn(path, self.model, self, self.recorded)


def shown_training(found: TrainingResult, model: Model, recorded: Recorded) -> ShownTraining:
    """The result of a training as an object with tables and plots."""
    known = {field.name: getattr(found, field.name) for field in fields(TrainingResult)}
    return ShownTraining(**known, model=model, recorded=recorded)


@dataclass(frozen=True, slots=True, repr=False)
class ShownFolds(Shown, FoldsResult):
    """Trainings of folds with their table; the plot shows the best fold."""

    model: Model
    recorded: Recorded

    def _said(self) -> str:
        reached = f"best {self.best.monitor:.6g} (fold {self.best.number})"
        return f"FoldsResult: {count(self.count, 'fold')}, {reached}"

    def _tables(self) -> Sequence[Table]:
        return [folds_cells(self)]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        rows: list[dict[str, Any]] = [
            {"fold": fold["fold"], "monitor": fold["monitor"], **metric}
            for fold in folds_record(self)["folds"]
            for metric in fold["metrics"] or [dict[str, Any]()]
        ]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name) for row in rows] for name in names}

    def _draw(self, path: Path) -> Path:
        return _drawn(path, self.model, self.best.training, self.recorded)


def _drawn(path: Path, model: Model, found: TrainingResult, recorded: Recorded) -> Path:
    """Plots the run in the folder, including epochs before it was resumed; else recorded events.

    Without a folder it shows filter taps only, because the data are no longer available.
    """
    if found.folder is None:
        return plot_run(path, recorded.epochs, learned_functions(model, found.weights, None))
    run = read_run(found.folder)
    return plot_run(path, [stage.epochs for stage in run.stages], functions_of_run(run))
