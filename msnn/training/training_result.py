"""Holds what a training returns: its result, or that it diverged or was interrupted."""

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
    """Trained weights in physical units, what each stage reached, and where the run is kept."""

    weights: Mapping[str, FloatArray]
    stages: tuple[StageResult, ...]
    folder: Path | None
    warnings: tuple[Diagnostic, ...]
    """Warnings of the data, the stages, their course, and the parameters at the end.

    Each once. Those of parameters that data do not determine come with standard errors alone.
    """
    standard_errors: StandardErrors | None = None
    """Of a run that is kept in a folder and came to its end."""
    starts: KeptStarts | None = None
    """Where the recordings of the training start, if what is scored decides that."""


class TrainingDivergedError(Exception):
    """A stage met a value that is not finite; the best weights so far are in `result`.

    `latest` leads to them where the run had been interrupted before, and only there.
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
        """Crosses to another process as its arguments: a pool waits for ever on what cannot."""
        return _diverged, (self.diagnostic, self.result, self.is_latest, self.sources)

    def _render_traceback_(self) -> list[str]:
        """Shows the message in a notebook in place of a traceback."""
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
    """The user ended the run; `result` has the best weights so far, `resume` goes on."""

    def __init__(self, result: TrainingResult) -> None:
        super().__init__("training was interrupted; it can be resumed")
        self.result = result

    def __reduce__(self) -> tuple[type[TrainingInterruptedError], tuple[TrainingResult]]:
        """Crosses to another process as its result: a pool waits for ever on what cannot."""
        return TrainingInterruptedError, (self.result,)

    def _render_traceback_(self) -> list[str]:
        """Shows the message in a notebook in place of a traceback."""
        return [f"{self}; the best weights so far are in the exception's `.result`"]
