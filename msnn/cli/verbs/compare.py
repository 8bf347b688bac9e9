"""`msnn compare`: trains several models, and ranks them by accuracy and by cost."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import (
    RUNS,
    ComparedRuns,
    CountsCost,
    DataRoot,
    Folds,
    Grid,
    HeldOut,
    Jobs,
    OutputFormat,
    PlotFile,
    RankedBy,
    ResultFormat,
    Seeds,
    Settings,
)


def compare(
    specs: Annotated[
        list[Path],
        typer.Argument(metavar="SPEC...", help="Specs, or folders of runs, to be compared."),
    ],
    grid: Grid = None,
    settings: Settings = None,
    seeds: Seeds = 1,
    folds: Folds = False,
    on: HeldOut = "val",
    by: RankedBy = None,
    cost: CountsCost = True,
    jobs: Jobs = None,
    data_root: DataRoot = None,
    out: ComparedRuns = RUNS,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Train several models, and rank them.

    Specs, or one spec with a grid over any of its values, are trained and measured on the same
    rows, which no training has seen: a validation set, or folds. The table has accuracy,
    information criteria, size, time, and the cost of a step of the C code; the Pareto front is
    marked. `runs.jsonl` logs every training: a logged one is not repeated, and an interrupted
    comparison continues.
    """
    from msnn.api import comparisons
    from msnn.cli.comparison_results import show_comparison, trials_shown

    with trials_shown(plot) as listener:
        found = comparisons.compare(
            specs,
            grid=grid or (),
            settings=settings or (),
            data_root=data_root,
            on=on,
            seeds=seeds,
            folds=folds,
            runs=out,
            jobs=jobs or os.cpu_count() or 1,
            by=by,
            cost=cost,
            listener=listener,
        )
    show_comparison(found, "compare", format, plot)
