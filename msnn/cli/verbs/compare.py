"""`msnn compare`: trains several models, and ranks them by accuracy and by cost."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import (
    RUNS,
    DataRoot,
    OutputFormat,
    PlotFile,
    ResultFormat,
    Settings,
    refuse_undrawable,
)


def compare(
    specs: Annotated[
        list[Path],
        typer.Argument(metavar="SPEC...", help="Specs, or folders of runs, to be compared."),
    ],
    grid: Annotated[
        list[str] | None,
        typer.Option(
            "--grid",
            metavar="KEY=V1,V2,...",
            help="Every choice of a value of the specs; several span a grid.",
        ),
    ] = None,
    settings: Settings = None,
    seeds: Annotated[
        int, typer.Option(min=1, help="Train each so often, from other initial values and orders.")
    ] = 1,
    folds: Annotated[
        bool, typer.Option("--folds", help="Train every fold of `split: {by: kfold, k}`.")
    ] = False,
    on: Annotated[
        str, typer.Option(metavar="SET", help="The rows held out that they are compared on.")
    ] = "val",
    by: Annotated[
        str | None,
        typer.Option(
            metavar="METRIC",
            help="What ranks them: fit, y.fit, y.rmse:record; default: the first of `validate`.",
        ),
    ] = None,
    cost: Annotated[
        bool, typer.Option("--cost/--no-cost", help="Count instructions and bytes of the C.")
    ] = True,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Trainings at once; default: one a processor.")
    ] = None,
    data_root: DataRoot = None,
    out: Annotated[
        Path,
        typer.Option("-o", "--out", metavar="FOLDER", help="Trainings are kept below, with a log."),
    ] = RUNS,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Train several models, and rank them.

    Specs, or one with a grid over any of its values, are trained and measured alike on rows that
    none has seen: a validation set, or folds. One table with accuracy, information criteria, size,
    time, and what a step of the C costs; the Pareto front is marked. `runs.jsonl` has every
    training: one that is there is not repeated, and an interrupted comparison goes on.
    """
    from msnn.api import trainings
    from msnn.cli.comparison_results import end_interrupted, show_comparison
    from msnn.cli.console import progress_stream
    from msnn.cli.ranks import speak_once
    from msnn.comparison.progress_lines import TrialLines
    from msnn.training.training_result import TrainingInterruptedError

    speak_once()
    refuse_undrawable(plot)
    try:
        found = trainings.compare(
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
            listener=TrialLines(progress_stream()),
        )
    except (KeyboardInterrupt, TrainingInterruptedError):
        raise end_interrupted() from None
    show_comparison(found, "compare", format, plot)
