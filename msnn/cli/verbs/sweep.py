"""`msnn sweep`: trains one spec with many values of it, and ranks them."""

from __future__ import annotations

import os
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
    SpecFile,
)

_ROWS = 20
"""Rows of the table as text; JSON has all rows."""
_PAUSE = 1.0
"""Seconds between two progress lines: small models train fifty times per second."""


def sweep(
    spec: SpecFile,
    grid: Grid = None,
    draw: Annotated[
        list[str] | None,
        typer.Option(
            "--draw",
            metavar="KEY=LAW",
            help="Draw a value: uniform(0.5, 2), log(1, 100) N/m, integer(1, 20), choice(a, b).",
        ),
    ] = None,
    draws: Annotated[
        int | None, typer.Option(min=1, help="How often values are drawn; default: 20.")
    ] = None,
    draw_seed: Annotated[
        int, typer.Option(min=0, help="Decides what is drawn; the log has it.")
    ] = 0,
    settings: Settings = None,
    seeds: Seeds = 1,
    folds: Folds = False,
    on: HeldOut = "val",
    by: RankedBy = None,
    cost: CountsCost = False,
    jobs: Jobs = None,
    ray: Annotated[
        str | None,
        typer.Option(
            "--ray",
            metavar="ADDRESS",
            help="Train on a Ray cluster: 10.0.0.1:6379, auto, or local to try it here.",
        ),
    ] = None,
    optuna: Annotated[
        str | None,
        typer.Option(
            "--optuna",
            metavar="STUDY",
            help="Let Optuna propose what is drawn; it keeps its study in this file or database.",
        ),
    ] = None,
    data_root: DataRoot = None,
    out: ComparedRuns = RUNS,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Train a spec with many values of its keys.

    Values are those of a grid, drawn at random, or both, for any key that `--set` can replace, by
    seeds and folds. The table, the Pareto front and the log are those of `msnn compare`: a training
    in `runs.jsonl` is not repeated, so an interrupted sweep continues and a larger one only trains
    the new values.
    """
    from msnn.api import comparisons
    from msnn.cli.comparison_results import show_comparison, trials_shown

    with trials_shown(plot, _PAUSE) as listener:
        found = comparisons.sweep(
            spec,
            grid=grid or (),
            draw=draw or (),
            draws=draws,
            draw_seed=draw_seed,
            settings=settings or (),
            data_root=data_root,
            on=on,
            seeds=seeds,
            folds=folds,
            runs=out,
            jobs=jobs or os.cpu_count() or 1,
            ray=ray,
            optuna=optuna,
            by=by,
            cost=cost,
            listener=listener,
        )
    # hundreds of models do not fit on a screen; `compare` has few and shows them all
    show_comparison(found, "sweep", format, plot, _ROWS)
