"""`msnn import`: reads a model that nnodely saved as a spec and weights."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat


def import_(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.json", help="What nnodely 1.x saved by `saveModel`.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The spec to write; default: MODEL.msnn.yaml beside it.",
        ),
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Convert a model of nnodely 1.x to a spec.

    The spec is readable, and predicts the same values as nnodely; the weights are written beside
    it. Functions in Python are translated from their source, or refused with the line: no code of
    the file is run. Existing files are not overwritten.
    """
    from msnn.api.models import import_nnodely
    from msnn.cli.console import json_result, report, result

    if out is not None and out.suffix not in (".yaml", ".yml") and not out.is_dir():
        raise typer.BadParameter(f"`{out}` does not end with .msnn.yaml", param_hint="'--out'")
    written = import_nnodely(model, out)
    report(written.warnings, (written.model.text.source,))
    if format is ResultFormat.JSON:
        files = {"spec": str(written.spec), "weights": str(written.weights)}
        names = written.model.names
        json_result("import", {**files, "inputs": names["input"], "outputs": names["output"]})
        return
    result(f"{written.spec}, {written.weights}")
    result(f"next: msnn simulate {written.spec} --weights {written.weights} --data LOG.csv")
