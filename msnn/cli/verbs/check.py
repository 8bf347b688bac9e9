"""`msnn check`: reads specs as a compiler reads programs, and says what is wrong with them."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from msnn.cli.arguments import Settings, tell_messages
from msnn.cli.exit_codes import ExitCode


class OutputFormat(StrEnum):
    """The format in which diagnostics are printed."""

    FULL = "full"
    CONCISE = "concise"
    JSON = "json"
    GITHUB = "github"
    SARIF = "sarif"


def check(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="SPEC…",
            help="Specs, program files of `compile`, folders with specs in and below them, or `-` "
            "for standard input.",
        ),
    ],
    strict_units: Annotated[
        bool, typer.Option("--strict-units", help="Units that do not fit are errors.")
    ] = False,
    settings: Settings = None,
    with_data: Annotated[
        bool,
        typer.Option("--data", help="Read the data too, and warn of what `msnn data` finds."),
    ] = False,
    format: Annotated[
        OutputFormat,
        typer.Option(help="How diagnostics are printed.", callback=tell_messages),
    ] = OutputFormat.FULL,
) -> None:
    """Check specs, and report what is wrong.

    Names, shapes, units and time of the model; then whether the sections data, train, validate and
    export fit it. Reads no data without `--data`.
    """
    from msnn.cli.console import json_result, report, result, spare_files_of
    from msnn.cli.spec_files import spec_files, text_of
    from msnn.project.workflow_checks import checked_model
    from msnn.reports.summary import summary_line
    from spec_schema.diagnostics.diagnostic import SpecError
    from spec_schema.diagnostics.render import records

    failed = False
    found: list[dict[str, Any]] = []
    for file in spec_files(files):
        try:
            text = text_of(file)
            # a path that no file has: sub-models and data are then looked for beside the current
            # folder
            name = file if text is None else Path("<stdin>")
            model = checked_model(name, settings or (), strict_units=strict_units, text=text)
            spare_files_of(model)
            diagnostics, sources = model.warnings, model.sources
            if with_data:
                from msnn.features.data_check.check import check_data

                diagnostics = (*diagnostics, *check_data(model).findings)
        # one broken spec keeps the others from no check: all files are told of, then the command
        # fails
        except SpecError as error:
            model, diagnostics, sources = None, error.diagnostics, error.sources
        failed |= model is None
        line = summary_line(model.program) if model is not None else None
        if format is OutputFormat.JSON:
            # as it was given on the command line, `-` too: who asked finds the record again by it
            record = {"file": str(file), "ok": model is not None, "summary": line}
            found.append(record | {"diagnostics": records(diagnostics)})
            continue
        report(diagnostics, sources)
        if line is not None:
            result(line)
    if format is OutputFormat.JSON:
        json_result("check", {"files": found})
    if failed:
        raise typer.Exit(ExitCode.DIAGNOSTICS)
