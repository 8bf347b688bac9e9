"""`msnn report`: a training run as one page, with the model running in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import DataRoot, OutputFormat, ResultFormat, RolloutEngine


def report(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help="The folder of a run: runs/NAME/latest.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="FILE", help="The page, .html; default: RUN/report.html."
        ),
    ] = None,
    data_root: DataRoot = None,
    engine: RolloutEngine = "auto",
    verification: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Show what `msnn verify --format json` has found of the C of this run.",
        ),
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Write a run as one HTML page.

    Measured and simulated records, errors, parameters with standard errors, learned functions,
    architecture and equations, data, training and C code. The model itself runs in the page if the
    extra `zig` is installed. The page is one file and loads nothing from the network.
    """
    from msnn.api import reports
    from msnn.cli import console
    from msnn.cli.console import StepProgress

    if out is not None and out.suffix not in (".html", ".htm"):
        # a spec or a record that stands there would be gone
        raise typer.BadParameter(f"`{out}` does not end with .html", param_hint="'--out'")
    with StepProgress(console.progress_stream()) as progress:
        written = reports.report(
            run,
            out,
            data_root=data_root,
            engine=engine,
            verification=verification,
            progress=progress.told,
        )
    console.report(written.warnings, ())
    if format is ResultFormat.JSON:
        found = {
            "file": str(written.path),
            "is_live": written.is_live,
            # in the record too, as whoever reads JSON seldom reads stderr
            "warnings": [each.message for each in written.warnings],
        }
        console.json_result("report", found)
    else:
        console.result(f"{written.path}: {written.path.stat().st_size / 1e6:.2f} MB")
