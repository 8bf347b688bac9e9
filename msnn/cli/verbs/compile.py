"""`msnn compile`: writes the compiled program, which every other verb takes instead of a spec."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import Settings, SpecFile
from msnn.cli.output_options import NOW


def compile_(
    spec: SpecFile,
    out: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            metavar="PATH",
            help="The folder to write into, or a `….program.json` file.",
        ),
    ] = Path("build"),
    strict_units: Annotated[
        bool, typer.Option("--strict-units", help="Units that do not fit are errors.")
    ] = False,
    settings: Settings = None,
) -> None:
    """Write the compiled program.

    Writes build/NAME.program.json, which every other command accepts instead of the spec.
    """
    from msnn.cli.console import report_model, result
    from msnn.model.load import load_model
    from msnn.model.program_file import program_place, write_program_file

    model = load_model(spec, settings or (), strict_units=strict_units)
    NOW.outputs.protect(program_place(model, out))
    NOW.outputs.spare([spec])
    report_model(model)
    result(str(write_program_file(model, out)))
