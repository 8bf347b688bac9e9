"""`msnn simulate`: runs a model freely over records and writes what it does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import (
    RUNS,
    DataRoot,
    Initial,
    OutputFormat,
    PlotFile,
    ResultFormat,
    RolloutEngine,
    RunsFolder,
    Settings,
    SpecFile,
    WeightsFile,
    refuse_two_origins,
    refuse_undrawable,
)
from msnn.cli.output_options import NOW

_DEFAULT, _BEGIN = Path("simulation.csv"), b"file,set,row"
"""The default output file, and its first bytes."""


def simulate(
    spec: SpecFile,
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", metavar="FILE", help="Files; default: the data of the spec."),
    ] = None,
    data_set: Annotated[
        str | None,
        typer.Option(
            "--data-set",
            metavar="NAME",
            help="Run over one set only; of --data FILE: the set whose columns it has.",
        ),
    ] = None,
    weights: WeightsFile = None,
    initial: Initial = False,
    runs: RunsFolder = RUNS,
    data_root: DataRoot = None,
    settings: Settings = None,
    engine: RolloutEngine = "auto",
    horizon: Annotated[
        str, typer.Option(metavar="record|N", help="Steps of each run; default: whole records.")
    ] = "record",
    intervals: Annotated[
        float | None,
        typer.Option(
            "--intervals",
            metavar="PERCENT",
            min=1.0,
            max=99.99,
            help="Also write the ends of prediction intervals that hold so many measured values.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help=f"The CSV file to write; default: {_DEFAULT}.",
        ),
    ] = None,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Simulate a model over recorded data.

    Every input that an output predicts is fed back, the others are read from the record. Writes one
    row per step: file, set, row and time as in the log, outputs, and beside them the measured
    values and the ends of prediction intervals.
    """
    from msnn.api import measurements
    from msnn.cli.console import (
        StepProgress,
        json_result,
        note,
        progress_stream,
        report,
        report_model,
        result,
    )
    from msnn.exports.export import spare_foreign_files
    from msnn.model.load import load_model
    from msnn.model.model_weights import choose_weights
    from msnn.simulation.simulate import run_record, simulation_program, write_simulation
    from msnn.tables import count

    refuse_two_origins(weights, initial)
    if horizon != "record" and not (horizon.isdecimal() and int(horizon) > 0):
        raise typer.BadParameter("`record` or a number of steps", param_hint="--horizon")
    refuse_undrawable(plot)
    if out is None:
        spare_foreign_files([_DEFAULT], sign=_BEGIN)
        NOW.outputs.protect(_DEFAULT)
    file = out or _DEFAULT
    model = load_model(spec, settings or ())
    report_model(model)
    chosen = choose_weights(model, weights, runs, initial=initial)
    report(chosen.warnings, model.sources)
    note(f"weights: {chosen.origin}")
    with StepProgress(progress_stream()) as progress:
        found = measurements.simulate(
            model,
            data,
            # intervals want the covariance of the parameters, which stands in the file beside the
            # weights
            chosen.given,
            horizon="record" if horizon == "record" else int(horizon),
            data_root=data_root,
            data_set=data_set,
            engine=engine,
            progress=progress.told,
            intervals=intervals,
        )
    report(found.warnings, model.sources)
    # the one that ran: its losses are gone, and with them the signals that only they read
    program = simulation_program(model.program)
    write_simulation(file, program, found)
    if format is ResultFormat.JSON:
        json_result("simulate", {"file": str(file), "runs": [run_record(run) for run in found]})
    else:
        rows = sum(run.steps for run in found)
        result(f"{file}: {count(len(found), 'run')}, {count(rows, 'step')}")
    if plot is not None:
        from msnn.reports.simulation_plots import plot_simulation

        # stdout has one JSON document and nothing else
        say = note if format is ResultFormat.JSON else result
        say(str(plot_simulation(plot, program, found)))
