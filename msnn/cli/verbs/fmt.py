"""`msnn fmt`: canonical layout of specs; comments stay, meaning stays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from msnn.cli.exit_codes import ExitCode
from msnn.cli.output_options import STANDARD_OUTPUT

if TYPE_CHECKING:
    from spec_schema.diagnostics.source import SourceText


def fmt(
    files: Annotated[list[Path], typer.Argument(metavar="SPEC…", help="Specs (.yaml, .json).")],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit code 1 if a file would change.")
    ] = False,
    diff: Annotated[
        bool, typer.Option("--diff", help="Write nothing; print what would change.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Write the text of the one SPEC there, `-` for stdout; default: into the spec.",
        ),
    ] = None,
) -> None:
    """Format specs.

    Puts sections in the order of the grammar, blank lines between them, and quotes around texts
    that YAML would misread. Comments and everything else stay as written. A spec with errors is not
    changed.
    """
    from backends.files.atomic_write import write_text
    from msnn.cli.console import note, report, result
    from spec_schema.diagnostics.diagnostic import SpecError
    from spec_schema.editors.format_spec import format_spec

    if output is not None and (check or diff or len(files) > 1):
        raise typer.BadParameter(
            "it takes one SPEC, without `--check` and `--diff`", param_hint="-o"
        )
    failed = False
    for file in files:
        try:
            source = _source(file)
            formatted = format_spec(source.path, source.text)
        except SpecError as error:
            report(error.diagnostics, error.sources)
            failed = True
            continue
        if output == STANDARD_OUTPUT:
            result(formatted.removesuffix("\n"))
            continue
        if output is not None:
            note(f"wrote {write_text(output, formatted)}")
            continue
        if formatted == source.text:
            continue
        if diff:
            result(_difference(source, formatted))
        # as formatters of code do it: 1 means "would change", so that a hook can refuse the commit
        if check or diff:
            failed = True
            note(f"would change {file}")
        else:
            note(f"wrote {write_text(file, formatted)}")
    if failed:
        raise typer.Exit(ExitCode.DIAGNOSTICS)


def _source(file: Path) -> SourceText:
    """The text of a spec's file with its original line endings."""
    from spec_schema.reading.reader import read_file

    return read_file(file)


def _difference(source: SourceText, formatted: str) -> str:
    import difflib

    old, new = source.text.splitlines(), formatted.splitlines()
    # lineterm="": `result` ends lines itself
    lines = difflib.unified_diff(old, new, source.path, f"{source.path} (formatted)", lineterm="")
    return "\n".join(lines)
