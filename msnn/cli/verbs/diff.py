"""`msnn diff`: what changed between two models or runs, and whether that ends a pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from msnn.cli.arguments import (
    DataRoot,
    NewSettings,
    OldSettings,
    OutputFormat,
    ResultFormat,
    Settings,
    SummaryFile,
    words_of,
)
from msnn.cli.exit_codes import ExitCode


def diff(
    old: Annotated[
        Path, typer.Argument(metavar="OLD", help="A spec, a program file, or the folder of a run.")
    ],
    new: Annotated[
        Path, typer.Argument(metavar="NEW", help="A spec, a program file, or the folder of a run.")
    ],
    settings: Settings = None,
    old_settings: OldSettings = None,
    new_settings: NewSettings = None,
    data_root: DataRoot = None,
    fail_on: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-on",
            metavar="any|breaking|worse|never",
            help="What is no success: any other meaning, an interface that breaks those who use "
            "it, a metric that is worse; several with commas; default: any.",
        ),
    ] = None,
    margin: Annotated[
        float,
        typer.Option(metavar="PERCENT", help="How much the error of a metric may grow.", min=0),
    ] = 1.0,
    summary: SummaryFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Compare two models, or two runs.

    Compares entry by entry, with shorthands written out: interface, units, parameters, equations,
    states, losses, stages. Then lists the changes of the interface that break users of the model.
    Two runs are also compared by their metrics, each measured by its own spec, and by their learned
    numbers. `--set` replaces a value of both; with SPEC twice, `--set-new` shows what a setting
    changes. Exit code 1 if a change of `--fail-on` is found, 3 if that is only a metric.
    """
    from msnn.api.changes import changes
    from msnn.cli.console import (
        StepProgress,
        json_result,
        progress_stream,
        report,
        result,
        spare_files_of,
    )
    from msnn.features.changes.model_changes import FailOn
    from msnn.features.changes.report import (
        changes_markdown,
        changes_record,
        changes_text,
        failures,
    )
    from msnn.model.load import load_model

    asked = {"any"} if fail_on is None else {*words_of(fail_on)}
    if (unknown := sorted(asked - {*get_args(FailOn)})) or not asked:
        message = f"`{''.join(unknown[:1])}` is none of {', '.join(get_args(FailOn))}"
        raise typer.BadParameter(message, param_hint="'--fail-on'")
    wanted, share = cast("set[FailOn]", asked), margin / 100
    of_both = tuple(settings or ())
    models = (
        load_model(old, (*of_both, *(old_settings or ()))),
        load_model(new, (*of_both, *(new_settings or ()))),
    )
    for model in models:
        spare_files_of(model)
    if "worse" in wanted and any(model.run is None for model in models):
        # before anything is measured, which may take minutes
        message = "`worse` compares what two runs have learned: give their folders"
        raise typer.BadParameter(message, param_hint="'--fail-on'")
    with StepProgress(progress_stream()) as progress:
        found = changes(
            *models, data_root=data_root, must_measure="worse" in wanted, progress=progress.told
        )
    report(found.warnings, ())
    # what is wrong is wrong with the new one: places are shown in its text
    report(failures(found, wanted, share), models[1].sources)
    if summary is not None:
        from msnn.cli.console import append_summary

        append_summary(summary, changes_markdown(found, share))
    if format is ResultFormat.JSON:
        json_result("diff", changes_record(found, share))
    else:
        result(changes_text(found, share))
    # a changed interface outweighs a metric that is worse: the exit code of the first is told
    if ("any" in wanted and not found.specs.is_same) or ("breaking" in wanted and found.breaking):
        raise typer.Exit(ExitCode.DIAGNOSTICS)
    if "worse" in wanted and found.worse(share):
        raise typer.Exit(ExitCode.LIMIT_BROKEN)
