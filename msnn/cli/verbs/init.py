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
        Path | None,
        typer.Option("--data", metavar="FILE", help="A CSV file to make the spec of."),
    ] = None,
    predict: Annotated[
        str | None,
        typer.Option("--predict", metavar="COLUMN", help="With --data: the column to predict."),
    ] = None,
) -> None:
    """Create a project that works.

    A folder with a spec, the JSON Schema that helps editors with it, some simulated data and a
    README with the next steps. With --data the spec is a linear model of the columns of a file,
    with their units, ranges, delays and sample time, and can be trained at once. Existing files are
    not overwritten.
    """
    from msnn.cli.console import note, result
    from msnn.features.data_check.first_spec.new_spec import TargetNotNamedError, new_project_from
    from msnn.project.new_project import new_project

    if data is None:
        if predict is not None:
            raise typer.BadParameter("names a column of `--data FILE`", param_hint="'--predict'")
        made = new_project(folder)
        result(f"{made}: {made.name}.msnn.yaml, data, README.md")
        return
    try:
        made, spec = new_project_from(folder, data, predict)
    except TargetNotNamedError as error:
        raise typer.BadParameter(str(error), param_hint="'--predict'") from None
    for line in spec.notes:
        note(f"note: {line}")
    result(f"{made}: {made.name}.msnn.yaml, README.md")
