"""`msnn doctor`: what is installed, how to install what is missing, and the cache of kernels."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat


def doctor(
    clean_cache: Annotated[
        bool, typer.Option("--clean-cache", help="Remove the compiled kernels first.")
    ] = False,
    unused_for: Annotated[
        float | None,
        typer.Option(metavar="DAYS", min=0, help="Remove only kernels not used for so long."),
    ] = None,
    down_to: Annotated[
        float | None,
        typer.Option(metavar="MB", min=0, help="Remove the longest unused until so much is left."),
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Show what is installed.

    Versions, the C compiler, optional packages; for a missing part the line that installs it. Only
    the parts that come with msnn are required. Also shows where compiled kernels are stored and how
    many.
    """
    from backends.native.kernel_cache import CacheLimits
    from msnn.cli.console import json_result, note, report, result
    from msnn.project.installation import (
        InstalledPart,
        cleaned_cache,
        installation,
        kernel_cache,
        plugin_parts,
        plugin_values,
    )
    from msnn.tables import table_text
    from spec_schema.plugins import look_up

    if not clean_cache and not (unused_for is None and down_to is None):
        message = "what is removed is said beside --clean-cache"
        raise typer.BadParameter(message, param_hint="'--unused-for', '--down-to'")
    if clean_cache:
        everything = unused_for is None and down_to is None
        # unused for 0 days is every kernel
        note(cleaned_cache(CacheLimits(0.0 if everything else unused_for, down_to)))
    cache = kernel_cache()
    remedy = "set MSNN_CACHE to a folder you may write"
    plugins = look_up()
    parts = [
        *installation(),
        *plugin_parts(plugins),
        InstalledPart("cache", "compiled kernels", cache.text, remedy),
    ]
    if format is ResultFormat.JSON:
        record = {
            "parts": [asdict(part) for part in parts],
            "plugins": plugin_values(plugins),
            "kernels": cache.values(),
        }
        json_result("doctor", record)
    else:
        rows = [(p.name, p.found or f"missing: {p.install}", p.purpose) for p in parts]
        result(table_text(("part", "found", "for"), rows))
    report((*plugins.warnings, *cache.warnings), ())
