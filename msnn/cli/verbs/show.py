"""`msnn show`: what a model exchanges with its surroundings and is made of; what a run reached."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, PlotFile, ResultFormat, Settings, refuse_undrawable


class GraphFormat(StrEnum):
    """The program that draws the graph."""

    MERMAID = "mermaid"
    SVG = "svg"


def show(
    spec: Annotated[
        Path,
        typer.Argument(metavar="SPEC|RUN", help="A spec or program file, or the folder of a run."),
    ],
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
        GraphFormat | None,
        typer.Option("--graph", help="Print signals and formulas as a graph: text, or a picture."),
    ] = None,
    latex: Annotated[bool, typer.Option("--latex", help="Print the equations as LaTeX.")] = False,
    settings: Settings = None,
    plot: PlotFile = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Show a model, or the results of a run.

    A model: inputs with unit and window, outputs, states, parameters, dimensions, losses. The
    folder of a run: stages with their losses, learned parameters with standard errors, warnings,
    and how to continue; --plot draws the losses and learned functions. With one of the views, a run
    shows that view of its model.
    """
    from msnn.cli.console import json_result, report_model, result
    from msnn.model.load import load_model
    from msnn.model.saved_run import followed

    views = (program, windows, resolved, interface, graph is not None, latex)
    if sum(views) > 1:
        message = "choose one of --program, --windows, --resolved, --interface, --graph, --latex"
        raise typer.BadParameter(message)
    # `runs/NAME/latest` is a link, or a file with a name where the system has no links
    spec = spec if spec.is_dir() else followed(spec)
    if spec.is_dir() and not any(views):
        if settings:
            # a setting cannot change numbers that were learned without it
            message = "--set takes a spec or a view of the model: what a run reached is as it is"
            raise typer.BadParameter(message)
        _show_run(spec, plot, format)
        return
    if plot is not None:
        raise typer.BadParameter("takes the folder of a run", param_hint="'--plot'")
    model = load_model(spec, settings or ())
    report_model(model)
    if format is ResultFormat.JSON:
        from msnn.reports.show import interface_record

        json_result("show", interface_record(model.program))
    elif program:
        from compiler.ir.text import program_text

        result(program_text(model.program).rstrip())
    elif windows:
        from msnn.reports.show import windows_text

        result(windows_text(model.program))
    elif resolved:
        from spec_schema.editors.spec_data import spec_data
        from spec_schema.yaml_tree.writer import yaml_text

        result(yaml_text(spec_data(model.spec)).rstrip("\n"))
    elif interface:
        from msnn.exports.describe import exports_text

        result(exports_text(model))
    elif graph is GraphFormat.SVG:
        from msnn.reports.diagram.svg import architecture_svg

        result(architecture_svg(model.spec))
    elif graph is not None:
        from msnn.reports.diagram.mermaid import mermaid_text

        result(mermaid_text(model.spec))
    elif latex:
        from msnn.reports.latex import latex_text

        result(latex_text(model.spec))
    else:
        from compiler.elaboration.section import section_of
        from msnn.reports.show import interface_text

        others = [problem.program for problem in model.problems.values()]
        parts = [interface_text(model.program, others)]
        parts += [
            section_of(line).text(model.problems[line.key]) for line, _ in model.spec.sections()
        ]
        result("\n\n".join(parts))


def _show_run(folder: Path, plot: Path | None, format: ResultFormat) -> None:
    from msnn.cli.console import json_result, note, result
    from msnn.reports.run_summary import read_run, run_record, run_text

    refuse_undrawable(plot)
    run = read_run(folder)
    if format is ResultFormat.JSON:
        json_result("show", run_record(run))
    else:
        result(run_text(run))
    if plot is not None:
        from msnn.reports.run_plots import functions_of_run, plot_run

        epochs = [stage.epochs for stage in run.stages]
        note(f"drawn: {plot_run(plot, epochs, functions_of_run(run))}")
