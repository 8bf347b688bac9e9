"""`msnn doctor`: what is installed, and the line that installs what is missing."""

from __future__ import annotations

from dataclasses import asdict

from msnn.cli.arguments import OutputFormat, ResultFormat


def doctor(format: OutputFormat = ResultFormat.TEXT) -> None:
    """Say what is installed.

    Versions, the C compiler, optional packages, where kernels are kept; what is missing with the
    line that installs it. All of it is optional but what comes with msnn.
    """
    from msnn.cli.console import json_result, result
    from msnn.project.installation import installation
    from msnn.tables import table_text

    parts = list(installation())
    if format is ResultFormat.JSON:
        json_result("doctor", {"parts": [asdict(part) for part in parts]})
        return
    rows = [(p.name, p.found or f"missing: {p.install}", p.purpose) for p in parts]
    result(table_text(("part", "found", "for"), rows))
