"""`msnn show`: what a model exchanges with its surroundings, and what it is made of."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat, SpecFile


class GraphFormat(StrEnum):
    """What draws the graph."""

    MERMAID = "mermaid"


def show(
    spec: SpecFile,
    program: Annotated[
        bool, typer.Option("--program", help="Print the compiled program instead.")
    ] = False,
    windows: Annotated[
        bool, typer.Option("--windows", help="Print the samples that are read of each signal.")
    ] = False,
    resolved: Annotated[
        bool, typer.Option("--resolved", help="Print the spec with every default written out.")
    ] = False,
    interface: Annotated[
        bool, typer.Option("--interface", help="Print the ports of every export.")
    ] = False,
    graph: Annotated[
        GraphFormat | None, typer.Option("--graph", help="Print signals and formulas as a graph.")
    ] = None,
    latex: Annotated[bool, typer.Option("--latex", help="Print the equations as LaTeX.")] = False,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Print interface and parameters, or another view of a model.

    Inputs with unit and window, outputs, states, parameters, dimensions, losses.
    """
    from msnn.cli.console import json_result, report, result
    from msnn.model_file import load_model

    views = (program, windows, resolved, interface, graph is not None, latex)
    if sum(views) > 1:
        message = "choose one of --program, --windows, --resolved, --interface, --graph, --latex"
        raise typer.BadParameter(message)
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
    elif resolved:
        from spec_schema.spec_data import spec_data
        from spec_schema.yaml_writer import yaml_text

        result(yaml_text(spec_data(model.spec)).rstrip("\n"))
    elif interface:
        from msnn.show_exports import exports_text

        result(exports_text(model))
    elif graph is not None:
        from msnn.graph import mermaid_text

        result(mermaid_text(model.spec))
    elif latex:
        from msnn.latex import latex_text

        result(latex_text(model.spec))
    else:
        from msnn.show import interface_text

        result(interface_text(model.program))
