"""`msnn data`: looks at measured data before a model does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import (
    DataRoot,
    PlotFile,
    Settings,
    SpecFile,
    refuse_undrawable,
)


def data(
    spec: SpecFile,
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", metavar="FILE", help="Files; default: the data of the spec."),
    ] = None,
    data_root: DataRoot = None,
    settings: Settings = None,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write all of it as JSON.")
    ] = None,
    plot: PlotFile = None,
) -> None:
    """Check the data of a spec.

    Files: time steps, gaps. Columns: missing values, spikes, limits, rounding, units. System:
    delays and impulse responses with a confidence band, time constants, excitation by the inputs,
    feedback. Each finding is a warning that names the key to write.
    """
    from msnn.cli.console import json_text, note, report, report_model, result
    from msnn.features.data_check.check import check_data
    from msnn.features.data_check.report import check_record, check_tables
    from msnn.model.load import load_model

    refuse_undrawable(plot)
    model = load_model(spec, settings or ())
    report_model(model)
    found = check_data(model, data, data_root)
    report(found.findings, model.sources)
    if json is not None:
        from backends.files.atomic_write import write_text

        write_text(json, json_text("data", check_record(found)) + "\n")
    result(check_tables(found))
    if plot is not None:
        from msnn.features.data_check.figure import plot_data_check

        note(f"drawn: {plot_data_check(plot, found)}")
