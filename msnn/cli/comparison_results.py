"""Runs a comparison or a sweep, prints its result, and sets the exit code."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import typer

from msnn.cli.arguments import ResultFormat, refuse_undrawable
from msnn.cli.console import json_result, note, progress_stream, result
from msnn.cli.exit_codes import ExitCode
from msnn.cli.ranks import speak_once
from msnn.features.comparison.compare import Comparison
from msnn.features.comparison.report import (
    TrialLines,
    comparison_notes,
    comparison_record,
    comparison_table,
)
from msnn.training.training_result import TrainingInterruptedError


@contextmanager
def trials_shown(plot: Path | None, pause: float = 0.0) -> Generator[TrialLines]:
    """A context that prints results of trainings as they complete, at most one line per `pause`
    seconds.

    After an interrupt it prints how to continue and raises typer.Exit. Raises BadParameter for an
    unknown format of `plot`, MissingExtraError without matplotlib.
    """
    speak_once()
    refuse_undrawable(plot)
    try:
        yield TrialLines(progress_stream(), pause)
    except (KeyboardInterrupt, TrainingInterruptedError):
        # what `runs.jsonl` has is not trained again: the same command line is how it goes on
        note(f"interrupted; this goes on: {shlex.join(['msnn', *sys.argv[1:]])}")
        raise typer.Exit(ExitCode.INTERRUPTED) from None


def show_comparison(
    found: Comparison,
    verb: str,
    format: ResultFormat,
    plot: Path | None,
    most: int | None = None,
) -> None:
    """Prints the comparison of the command `verb` (as text at most `most` rows), notes and plot.
    Raises typer.Exit if a training was refused, or if none was completed.
    """
    if format is ResultFormat.JSON:
        json_result(verb, comparison_record(found))
    else:
        result(comparison_table(found, most))
        if most is not None and len(found.entries) > most:
            note(f"{len(found.entries)} models, of which these; `--format json` has all")
    for line in comparison_notes(found):
        note(line)
    if plot is not None:
        from msnn.features.comparison.report import plot_comparison

        note(f"drawn: {plot_comparison(plot, found)}")
    # a refused spec comes before divergence: it is to be mended, where another seed may do for the
    # other
    if any(line.state == "refused" for entry in found.entries for line in entry.failed):
        raise typer.Exit(ExitCode.DIAGNOSTICS)
    if found.best is None:
        raise typer.Exit(ExitCode.DIVERGED)
