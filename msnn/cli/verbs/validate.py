"""`msnn validate`: measures a trained model, and fails when a limit of the spec is broken."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import (
    EVERY_ENGINE,
    RUNS,
    DataRoot,
    Initial,
    OutputFormat,
    PlotFile,
    ResultFormat,
    RunsFolder,
    Settings,
    SpecFile,
    SummaryFile,
    ValidationEngine,
    WeightsFile,
    refuse_two_origins,
    refuse_undrawable,
)
from msnn.cli.exit_codes import ExitCode


def validate(
    spec: SpecFile,
    weights: WeightsFile = None,
    initial: Initial = False,
    runs: RunsFolder = RUNS,
    data_root: DataRoot = None,
    settings: Settings = None,
    engine: ValidationEngine = "auto",
    intervals: Annotated[
        bool,
        typer.Option(
            "--intervals", help="Also count how often targets lie inside prediction intervals."
        ),
    ] = False,
    junit: Annotated[
        Path | None,
        typer.Option("--junit", metavar="FILE", help="Also write JUnit XML, a test a limit."),
    ] = None,
    summary: SummaryFile = None,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Measure the trained model.

    Measures the entries of the spec's `validate` section, by default on the set `test`: its metrics
    with their limits, every metric of the same outputs, and the growth of errors along rollouts.
    Exit code 3 if a limit is broken.
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
    from msnn.model.load import load_model
    from msnn.model.model_weights import choose_weights
    from msnn.simulation.engines.open_rollouts import known_engine
    from msnn.validation.reports.errors_report import coverage_table, regions_table, residuals_table
    from msnn.validation.reports.report import (
        EnginesReport,
        broken_limits,
        curves_table,
        engines_record,
        engines_table,
        junit_text,
        measurements_table,
        metrics_markdown,
        metrics_record,
        metrics_table,
    )

    if intervals and engine == EVERY_ENGINE:
        message = "are counted by one engine, not by `--engine all`"
        raise typer.BadParameter(message, param_hint="'--intervals'")
    # before the model is loaded: a word that is wrong costs no time
    known_engine(engine, EVERY_ENGINE)
    refuse_two_origins(weights, initial)
    refuse_undrawable(plot)
    model = load_model(spec, settings or ())
    report_model(model)
    chosen = choose_weights(model, weights, runs, initial=initial)
    report(chosen.warnings, model.sources)
    note(f"weights: {chosen.origin}")
    # as a file they say of which rows they were trained and how sure they are
    known = chosen.given
    every: EnginesReport | None = None
    with StepProgress(progress_stream()) as progress:
        if engine == EVERY_ENGINE:
            every = measurements.validate_every_engine(
                model, known, data_root=data_root, progress=progress.told
            )
            # limits are judged by the interpreter's figures (decision 0218), the others are
            # compared with it
            found = every.judged
        else:
            found = measurements.validate(
                model,
                known,
                data_root=data_root,
                engine=engine,
                progress=progress.told,
                intervals=intervals,
            )
    report(found.warnings, model.sources)
    if junit is not None:
        from backends.files.atomic_write import write_text

        write_text(junit, junit_text(model.name, found))
    if summary is not None:
        from msnn.cli.console import append_summary

        append_summary(summary, metrics_markdown(model.name, found))
    if every is not None:
        for name, why in every.left_out.items():
            note(f"{name} is left out: {why}")
    if format is ResultFormat.JSON:
        record = metrics_record(found) if every is None else engines_record(every)
        json_result("validate", record)
    elif every is not None:
        result(engines_table(every))
    else:
        tables = (
            metrics_table(found),
            measurements_table(found),
            curves_table(found),
            residuals_table(found.measurements),
            regions_table(found.measurements),
            coverage_table(found.measurements),
        )
        result("\n\n".join(table for table in tables if table))
    if plot is not None:
        from msnn.reports.simulation_plots import plot_validation

        note(f"drawn: {plot_validation(plot, found)}")
    # after all that was asked for is written: a pipeline wants the report of a broken limit most
    if not found.passed:
        report(broken_limits(found), model.sources)
        raise typer.Exit(ExitCode.LIMIT_BROKEN)
