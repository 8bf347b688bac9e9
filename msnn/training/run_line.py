"""Builds the log line of a training."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

from compiler.ir.program import Program
from msnn.data.dataset import Dataset
from msnn.model.learned_numbers import learned_numbers
from msnn.model.model import Model
from msnn.model.saved_run import FOLD_SETTING
from msnn.model.spec_hash import hash_of
from msnn.model.weights.weights_file import initial_weights
from msnn.training.records.run_log import LOG, RunLine, append
from msnn.training.records.run_record import data_hash
from msnn.training.training_result import TrainingDivergedError, TrainingResult
from spec_schema.diagnostics.diagnostic import describe
from spec_schema.reading.setting_values import one_form
from spec_schema.version import __version__


def begun(
    model: Model, data: Dataset, *, seed: int = 0, fold: int | None = None, held_out: str = ""
) -> RunLine:
    """The line of a training before it begins: its identity, and everything that determines its
    result.

    `held_out` is the set for evaluation.
    """
    # which fold it is stands beside them
    given = (text for text in model.settings if fold is None or not text.startswith(FOLD_SETTING))
    settings = tuple(map(one_form, given))
    spec, of_data = hash_of(model.text, model.parts, settings), data_hash(data)
    # the version too: another one may train the same spec to other weights
    decides = [__version__, spec, _initial_hash(model.program), of_data, seed, fold, held_out]
    return RunLine(
        key=hashlib.sha256(json.dumps(decides).encode()).hexdigest(),
        model=model.name,
        spec=str(model.path),
        spec_sha256=spec,
        settings=settings,
        seed=seed,
        fold=fold,
        data_sha256=of_data,
        state="finished",
        reason="",
        parameters=learned_numbers(model.program, model.spec.train),
        version=__version__,
    )


def ended(line: RunLine, found: TrainingResult, runs: Path | None) -> RunLine:
    """The line with the results of a completed training."""
    kept = found.folder
    if runs is None or kept is None:
        kept = None
    elif kept.is_relative_to(runs):
        kept = kept.relative_to(runs)
    else:  # it was taken elsewhere, and went on there
        kept = kept.absolute()
    return replace(
        line,
        reason=found.stages[-1].reason,
        monitor=found.stages[-1].best_value,
        seconds=sum(stage.seconds for stage in found.stages),
        folder=None if kept is None else kept.as_posix(),
    )


def diverged(line: RunLine, error: TrainingDivergedError) -> RunLine:
    """The line of a training that met a non-finite value."""
    return replace(line, state="diverged", reason=describe(error.diagnostic))


def _initial_hash(program: Program) -> str:
    """The hash of the initial values; values from files are not in the text of the spec."""
    digest = hashlib.sha256()
    for name, values in initial_weights(program).items():
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()


def log(runs: Path | None, line: RunLine) -> None:
    """Appends the line to the log in the folder of runs; does nothing if `runs` is None."""
    if runs is not None:
        append(runs / LOG, line)
