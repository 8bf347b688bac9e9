"""What exports in fixed point say to their user: what cannot be, and how large the error is."""

from __future__ import annotations

import json
from pathlib import Path

from msnn.exports.export import ExportPlan, FixedPoint
from msnn.tables import table_text
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def fixed_point_faults(plan: ExportPlan, dtype: FixedPoint) -> tuple[Diagnostic, ...]:
    """Why the model cannot be exported in fixed point with its initial weights."""
    from backends.fixed_point.write_fixed_c import WIDTHS
    from compiler.fixed_point.compile_integers import integer_program
    from compiler.interpreter.interpreter import physical_weights

    try:
        integer_program(plan.program, physical_weights(plan.program, {}), WIDTHS[dtype])
    except SpecError as error:
        return error.diagnostics
    return ()


def error_table(folder: Path, prefix: str) -> str:
    """The errors against float64 that the export in a folder has recorded.

    Those that were seen, with over how many steps, and below what is proved of a single one.
    """
    about = json.loads((folder / f"{prefix}.json").read_text(encoding="utf-8"))
    rows = [
        (
            row["output"],
            f"{row['largest']:.2g}",
            f"{row['rms']:.2g}",
            f"{row['range']:.4g}",
            f"{row['largest'] / row['range']:.1e}" if row["range"] else "",
        )
        for row in about["errors"]
    ]
    steps = max((row["steps"] for row in about["errors"]), default=0)
    bounds = [
        (
            row["name"],
            row["kind"],
            "not proved" if (most := row["largest"]) is None else f"{most:.2g}",
        )
        for row in about["step_errors"]
        if row["largest"] != 0.0
    ]
    header = ("output", "largest error", "rms", "range", "of range")
    return (
        f"Error of {about['c']['dtype']} against float64, seen over {steps:,} steps:\n"
        + table_text(header, rows, numbers=[1, 2, 3, 4])
        + "\n\nWhat one step adds at most, proved:\n"
        + table_text(("value", "kind", "at most"), bounds, numbers=[2])
    )
