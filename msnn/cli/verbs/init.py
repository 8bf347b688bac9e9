"""`msnn init`: makes a project that works, to be changed into one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def init(
    folder: Annotated[
        Path, typer.Argument(metavar="NAME", help="The folder to make; its name is the model's.")
    ],
) -> None:
    """Make a project that works.

    A folder with a spec, the JSON Schema that helps editors with it, a little simulated data and a
    README that shows the next steps. Nothing that exists is overwritten.
    """
    from msnn.cli.console import result
    from msnn.project.new_project import new_project

    made = new_project(folder)
    result(f"{made}: {made.name}.msnn.yaml, data, README.md")
