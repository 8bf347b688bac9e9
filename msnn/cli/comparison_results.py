"""Shows what a comparison or a sweep has found, and ends the command as it ended."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import typer

from msnn.cli.arguments import ResultFormat
from msnn.cli.console import json_result, note, result
from msnn.cli.exit_codes import ExitCode
from msnn.comparison.compare import Comparison
from msnn.comparison.table import comparison_notes, comparison_record, comparison_table


def show_comparison(
    found: Comparison,
    verb: str,
    format: ResultFormat,
    plot: Path | None,
    most: int | None = None,
) -> None:
    """The table, with `most` rows as text, notes and plot; an exit where something went wrong."""
    if format is ResultFormat.JSON:
        json_result(verb, comparison_record(found))
    else:
        result(comparison_table(found, most))
        if most is not None and len(found.entries) > most:
            note(f"{len(found.entries)} models, of which these; `--format json` has all")
    for line in comparison_notes(found):
        note(line)
    if plot is not None:
        from msnn.comparison.plot import plot_comparison

        note(f"drawn: {plot_comparison(plot, found)}")
    # a refused spec comes before divergence: it is to be mended, where another seed may do for the
    # other
    if any(line.state == "refused" for entry in found.entries for line in entry.failed):
        raise typer.Exit(ExitCode.DIAGNOSTICS)
    if found.best is None:
        raise typer.Exit(ExitCode.DIVERGED)


def end_interrupted() -> typer.Exit:
    """Says how an interrupted comparison goes on."""
    # what `runs.jsonl` has is not trained again: the same command line is how it goes on
    note(f"interrupted; this goes on: {shlex.join(['msnn', *sys.argv[1:]])}")
    return typer.Exit(ExitCode.INTERRUPTED)
