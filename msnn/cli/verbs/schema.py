"""`msnn schema`: the JSON Schema of specs, for editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def schema(
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="The file to write; default: stdout."),
    ] = None,
) -> None:
    """Write the JSON Schema of specs.

    With it an editor completes keys, shows what they are for, and marks mistakes while you type. A
    spec names it in its first line: # yaml-language-server: $schema=./msnn.schema.json
    """
    from msnn.cli.console import note, report, result
    from spec_schema.editors.json_schema import json_schema_text
    from spec_schema.plugins import look_up

    # the keys of plug-ins too, for editors of whoever has them installed
    report(look_up().warnings, ())
    text = json_schema_text()
    if output is None:
        result(text.rstrip("\n"))
    else:
        from backends.files.atomic_write import write_text

        note(f"wrote {write_text(output, text)}")
