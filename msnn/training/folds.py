"""Trains a model once per fold of its data, and evaluates each on the held-out rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from backends.files.atomic_write import write_text
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning.stages import no_folds
from msnn.errors.learning.training import no_checkpoint
from msnn.model.model import Model
from msnn.model.saved_run import CHECKPOINT, FOLD, FOLD_SETTING, LATEST, newest, read_json
from msnn.model.trained_model import HELD_OUT
from msnn.tables import Table
from msnn.training.plans.stage_result import monitor_order
from msnn.training.records.curves import finite
from msnn.training.records.progress import EpochEnd, Progress, Silent, StageEnd, StageStart
from msnn.training.records.run_folder import RunFolder, new_run_folder
from msnn.training.records.run_log import measured_in
from msnn.training.records.training_options import TrainingOptions, in_folder
from msnn.training.train import train
from msnn.training.training_result import TrainingResult, begun, ended, log
from msnn.validation.reports.words import rollout_text, unit_text
from msnn.validation.validate import MetricRow, ValidationReport, validate
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

RECORD = "folds.json"


@dataclass(frozen=True, slots=True)
class Fold:
    """A training without the rows of one fold, and its metrics on these rows."""

    number: int
    training: TrainingResult
    report: ValidationReport

    @property
    def monitor(self) -> float:
        """The monitor of the last stage, which was computed on the held-out fold."""
        return self.training.stages[-1].best_value


@dataclass(frozen=True, slots=True)
class FoldsResult:
    """The result of a cross-validation: all trained folds, and the folder with one sub-folder per
    fold.
    """

    folds: tuple[Fold, ...]
    folder: Path | None
    count: int
    """Total number of folds."""

    @property
    def best(self) -> Fold:
        """The fold with the lowest monitor of the last stage."""
        return min(self.folds, key=lambda fold: monitor_order(fold.monitor))

    @property
    def weights(self) -> Mapping[str, FloatArray]:
        """The weights of the best fold."""
        return self.best.training.weights


def train_folds(
    model: Model,
    read: Callable[[Model], Dataset],
    options: TrainingOptions,
    progress: Progress | None,
    weights: Mapping[str, FloatArray] | None,
) -> FoldsResult:
    """Cross-validation: trains a model once per fold of `data.split`, each from the same initial
    weights.

    `read` loads the data of a model, `weights` are the initial ones (None: those of the spec).
    `folds.json` lists the completed folds; `latest` points to the best one once all are complete.
    `resume` continues the newest unfinished cross-validation: completed folds are only evaluated
    again, and an interrupted one continues from its checkpoint. Raises the errors of a training,
    and SpecError if the data have no folds.
    """
    count = fold_count(model)
    folder = _folder(model, options)
    # one for all folds: warnings about the spec are equal in each and are shown once
    shown = _FoldProgress(progress or Silent(), count)
    folds: list[Fold] = []
    for number in range(1, count + 1):
        shown.fold = number
        one = of_fold(model, number)
        data = read(one)
        stages = one.spec.train
        own = _options(replace(options, settings=one.settings), folder, number)
        found = train(one.program, data, stages, own, shown, weights)
        report = validate(
            one.program,
            data,
            one.spec.checks,
            found.weights,
            on=HELD_OUT,
            stages=stages,
            kept=found.starts,
        )
        folds.append(Fold(number, found, report))
        line = begun(one, data, fold=number, held_out=HELD_OUT)
        line = replace(ended(line, found, options.runs), held_out=measured_in(report))
        log(options.runs, line)
        # all but the last: with every fold in it the record says that there is nothing to resume,
        # which is true only when `latest` leads to the best one
        if number < count:
            _write_record(FoldsResult(tuple(folds), folder, count))
    result = FoldsResult(tuple(folds), folder, count)
    if folder is not None and result.best.training.folder is not None:
        best = result.best.training.folder
        RunFolder(best, model.program, folder.parent / LATEST).become_latest()
        _write_record(result)  # with all folds: from here on there is nothing to resume
        for checkpoint in folder.glob(f"{FOLD}*/{CHECKPOINT}"):
            checkpoint.unlink()
    return result


def _folder(model: Model, options: TrainingOptions) -> Path | None:
    """The folder of all folds: a new one, or that of the resumed training."""
    if options.runs is None:
        return None
    if not options.resume:
        return new_run_folder(model.program, options.runs).path
    parent = options.runs / model.program.name
    found = newest(parent, _is_unfinished)
    if found is None:
        raise SpecError((no_checkpoint(str(parent)),))
    return found


def _is_unfinished(folder: Path) -> bool:
    if next(folder.glob(f"{FOLD}*/{CHECKPOINT}"), None) is None:
        return False
    record = read_json(folder / RECORD)
    return len(record.get("folds", ())) < record.get("of", 1)


def _options(options: TrainingOptions, folder: Path | None, number: int) -> TrainingOptions:
    """The options of one fold's training; it restarts if it has no checkpoint."""
    if folder is None:
        return options
    return in_folder(options, folder / f"{FOLD}{number}", goes_on=options.resume)


def _write_record(result: FoldsResult) -> None:
    if result.folder is not None:
        text = json.dumps(finite(folds_record(result)), ensure_ascii=False, indent=2)
        write_text(result.folder / RECORD, text + "\n", durable=True)


def fold_count(model: Model) -> int:
    """The number of folds in the data of a model. Raises SpecError if the data have none."""
    data = model.spec.data
    split = None if data is None else data.split
    if split is None or split.by != "kfold":
        span = None if split is None else split.place.key
        raise SpecError((no_folds(span),))
    assert split.k is not None, "the schema asks for `k:`"
    return split.k


def of_fold(model: Model, number: int) -> Model:
    """The model with fold `number` held out, counted from 1."""
    data = model.spec.data
    assert data is not None
    assert data.split is not None
    split = data.split.model_copy(update={"fold": number})
    section = data.model_copy(update={"split": split})
    spec = model.spec.model_copy(update={"data": section})
    # as a setting too: a run of another fold would be measured on rows that it was trained on
    others = (text for text in model.settings if not text.startswith(FOLD_SETTING))
    return replace(model, spec=spec, settings=(*others, f"{FOLD_SETTING}{number}"))


def folds_table(result: FoldsResult) -> str:
    """The results of the folds as a printed table: one row per fold, and mean ± standard
    deviation.
    """
    return folds_cells(result).text


def folds_cells(result: FoldsResult) -> Table:
    """A table with one row per fold, and mean ± standard deviation of each column."""
    columns = _columns(result)
    rows = [
        (str(fold.number), *(f"{values[index]:.6g}" for values in columns.values()))
        for index, fold in enumerate(result.folds)
    ]
    summary = (f"{_mean(values):.6g} ± {_deviation(values):.2g}" for values in columns.values())
    header = ("fold", *columns)
    return Table(header, [*rows, ("mean ± std", *summary)], numbers=range(1, len(header)))


def folds_record(result: FoldsResult) -> dict[str, Any]:
    """The results of the folds as a JSON object: monitor, metrics and folder of each, and
    the best.
    """
    columns = _columns(result)
    return {
        "best": result.best.number,
        "of": result.count,
        "folds": [
            {
                "fold": fold.number,
                "folder": fold.training.folder and str(fold.training.folder),
                "monitor": fold.monitor,
                "metrics": [
                    {
                        "of": row.of,
                        "metric": row.metric,
                        "value": row.value,
                        "unit": row.unit and row.unit.text,
                        "horizon": row.horizon,
                        "rows": row.rows,
                        "scored": row.scored,
                    }
                    for row in fold.report.rows
                ],
            }
            for fold in result.folds
        ],
        "summary": [
            {"of": name, "mean": _mean(values), "std": _deviation(values)}
            for name, values in columns.items()
        ],
    }


def _columns(result: FoldsResult) -> dict[str, list[float]]:
    """The compared values of all folds, by column heading."""
    columns = {"monitor": [fold.monitor for fold in result.folds]}
    for rows in zip(*(fold.report.rows for fold in result.folds), strict=True):
        # entries that differ only in their set or limits share one column
        columns[_heading(rows[0])] = [row.value for row in rows]
    return columns


def _heading(row: MetricRow) -> str:
    unit = f" [{unit_text(row.unit)}]" if row.unit is not None else ""
    return f"{row.of} {row.metric}{unit}, {rollout_text(row)}"


def _mean(values: list[float]) -> float:
    return float(np.mean(values))


def _deviation(values: list[float]) -> float:
    """Sample standard deviation with n − 1; NaN for a single value."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


class _FoldProgress:
    """Forwards progress events with the fold in the name of the stage, and each warning
    only once.
    """

    def __init__(self, shown: Progress, folds: int) -> None:
        self.fold = 1
        self._shown, self._folds = shown, folds
        self._said: list[Diagnostic] = []

    def stage_started(self, event: StageStart) -> None:
        self._shown.stage_started(replace(event, name=self._named(event.name)))

    def epoch_ended(self, event: EpochEnd) -> None:
        self._shown.epoch_ended(replace(event, stage=self._named(event.stage)))

    def stage_ended(self, event: StageEnd) -> None:
        self._shown.stage_ended(replace(event, stage=self._named(event.stage)))

    def warned(self, diagnostic: Diagnostic) -> None:
        if diagnostic not in self._said:
            self._said.append(diagnostic)
            self._shown.warned(diagnostic)

    def _named(self, stage: str) -> str:
        return f"{stage} of fold {self.fold}/{self._folds}"
