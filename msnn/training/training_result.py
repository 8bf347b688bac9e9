"""Defines the results of a training: outcome, log line, exceptions when it ends early."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.model.model import Model, learned_numbers
from msnn.model.model_files import hash_of
from msnn.model.saved_run import FOLD_SETTING
from msnn.model.weights.kept_starts import KeptStarts
from msnn.model.weights.weights_file import initial_weights
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.learned.standard_errors import StandardErrors
from msnn.training.records.run_log import LOG, RunLine, append
from msnn.training.records.run_record import data_hash
from spec_schema.diagnostics.diagnostic import Diagnostic, describe, shown_whole
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.setting_values import one_form
from spec_schema.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingResult:
    """Trained weights in physical units, the result of each stage, and the folder of the run."""

    weights: Mapping[str, FloatArray]
    stages: tuple[StageResult, ...]
    folder: Path | None
    warnings: tuple[Diagnostic, ...]
    """Warnings about the data, the stages, their course and the final parameters, each once.

    Warnings about parameters that the data do not determine require standard errors.
    """
    standard_errors: StandardErrors | None = None
    """Standard errors of a completed run with a folder."""
    starts: KeptStarts | None = None
    """Initial states of the training recordings, if scored rows determine them."""


class TrainingDivergedError(Exception):
    """A stage met a non-finite value; the best weights so far are in `result`.

    `latest` points to them only if the run had been interrupted before.
    """

    def __init__(
        self,
        diagnostic: Diagnostic,
        result: TrainingResult,
        *,
        is_latest: bool,
        sources: tuple[SourceText, ...] = (),
    ) -> None:
        super().__init__(diagnostic.message)
        self.diagnostic = diagnostic
        self.is_latest = is_latest
        self.result = result
        self.sources = sources

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        """Tells pickle to rebuild the exception from its arguments, so that a process pool can
        return it.
        """
        return _diverged, (self.diagnostic, self.result, self.is_latest, self.sources)

    def _render_traceback_(self) -> list[str]:
        """Shows the message in a notebook instead of a traceback."""
        kept = "the best weights so far are in the exception's `.result`"
        return [*shown_whole([self.diagnostic], self.sources), kept]


def _diverged(
    diagnostic: Diagnostic,
    result: TrainingResult,
    is_latest: bool,
    sources: tuple[SourceText, ...],
) -> TrainingDivergedError:
    return TrainingDivergedError(diagnostic, result, is_latest=is_latest, sources=sources)


class TrainingInterruptedError(Exception):
    """The user ended the run; `result` has the best weights so far.

    `msnn.train(..., resume=True)` continues the run, if it has a folder.
    """

    def __init__(self, result: TrainingResult) -> None:
        super().__init__("training was interrupted; it can be resumed")
        self.result = result

    def __reduce__(self) -> tuple[type[TrainingInterruptedError], tuple[TrainingResult]]:
        """Tells pickle to rebuild the exception from its result, so that a process pool can return
        it.
        """
        return TrainingInterruptedError, (self.result,)

    def _render_traceback_(self) -> list[str]:
        """Shows the message in a notebook instead of a traceback."""
        return [f"{self}; the best weights so far are in the exception's `.result`"]


def begun(
    model: Model, data: Dataset, *, seed: int = 0, fold: int | None = None, held_out: str = ""
) -> RunLine:
    """The line of `runs.jsonl` for a training that begins: its model, settings, data, seed and
    fold.

    `held_out` is the set on which the trained model is evaluated.
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
    """The line of `runs.jsonl` for a completed training, with its results."""
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
    """The line of `runs.jsonl` for a training that met a non-finite value."""
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
