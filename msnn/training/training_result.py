"""Defines the results of a training: its outcome, and exceptions for divergence and interrupts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from msnn.data.dataset import FloatArray
from msnn.model.weights.kept_starts import KeptStarts
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.learned.standard_errors import StandardErrors
from spec_schema.diagnostics.diagnostic import Diagnostic, shown_whole
from spec_schema.diagnostics.source import SourceText


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
        """Pickles the exception by its arguments, so that a process pool can return it."""
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
    """The user ended the run; `result` has the best weights so far, `resume` continues it."""

    def __init__(self, result: TrainingResult) -> None:
        super().__init__("training was interrupted; it can be resumed")
        self.result = result

    def __reduce__(self) -> tuple[type[TrainingInterruptedError], tuple[TrainingResult]]:
        """Pickles the exception by its result, so that a process pool can return it."""
        return TrainingInterruptedError, (self.result,)

    def _render_traceback_(self) -> list[str]:
        """Shows the message in a notebook instead of a traceback."""
        return [f"{self}; the best weights so far are in the exception's `.result`"]
