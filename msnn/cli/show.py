"""`msnn show`: what a model exchanges with its surroundings, and what it is made of."""

from __future__ import annotations

from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat, SpecFile


def show(
    spec: SpecFile,
    program: Annotated[
        bool, typer.Option("--program", help="Print the compiled program instead.")
    ] = False,
    windows: Annotated[
        bool, typer.Option("--windows", help="Print the samples that are read of each signal.")
    ] = False,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Print interface and parameters.

    Inputs with unit and window, outputs, states, parameters, dimensions, losses.
    """
    from msnn.cli.console import json_result, report, result
    from msnn.model_file import load_model

    model = load_model(spec)
    report(model.warnings, model.sources)
    if format is ResultFormat.JSON:
        from msnn.show import interface_record

        json_result("show", interface_record(model.program))
    elif program:
        from compiler.program_text import program_text

        result(program_text(model.program).rstrip())
    elif windows:
        from msnn.show import windows_text

        result(windows_text(model.program))
    else:
        from msnn.show import interface_text

        result(interface_text(model.program))
