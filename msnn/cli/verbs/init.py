"""`msnn init`: makes a project that works, to be changed into one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def init(
    folder: Annotated[
        Path, typer.Argument(metavar="NAME", help="The folder to make; its name is the model's.")
    ],
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            metavar="FILE",
            help="A table of text or a workbook to make the spec of, or a pattern; repeatable.",
        ),
    ] = None,
    predict: Annotated[
        list[str] | None,
        typer.Option(
            "--predict", metavar="COLUMN", help="With --data: a column to predict; repeatable."
        ),
    ] = None,
) -> None:
    """Create a project that works.

    A folder with a spec, the JSON Schema that helps editors with it, some simulated data and a
    README with the next steps. With --data the spec is a linear model of the columns of files, with
    their units, ranges, delays and sample time, and starts at its least-squares fit. Existing files
    are not overwritten.
    """
    from msnn.cli.console import note, result
    from msnn.features.data_check.first_spec.new_spec import TargetNotNamedError, new_project_from
    from msnn.project.new_project import new_project

    if not data:
        if predict:
            raise typer.BadParameter("names a column of `--data FILE`", param_hint="'--predict'")
        made = new_project(folder)
        result(f"{made}: {made.name}.msnn.yaml, data, README.md")
        return
    try:
        made, spec = new_project_from(folder, data, predict or ())
    except TargetNotNamedError as error:
        raise typer.BadParameter(str(error), param_hint="'--predict'") from None
    for line in spec.notes:
        note(f"note: {line}")
    result(f"{made}: {made.name}.msnn.yaml, README.md")
