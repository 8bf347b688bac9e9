"""`msnn a2l`: completes the ASAP2 file of an export by the addresses in an ELF file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat


def a2l(
    elf: Annotated[
        Path,
        typer.Argument(metavar="ELF", help="A linked program that runs the C, built with -g."),
    ],
    export: Annotated[
        Path, typer.Option(metavar="DIR", help="What `msnn export --to c` wrote.")
    ] = Path("build/export/c"),
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Where it goes; default: ELF with the ending .a2l."
        ),
    ] = None,
    params: Annotated[
        str | None, typer.Option(metavar="NAME", help="The variable with the parameters.")
    ] = None,
    state: Annotated[
        str | None, typer.Option(metavar="NAME", help="The variable with the state.")
    ] = None,
    inputs: Annotated[
        str | None, typer.Option(metavar="NAME", help="The variable with the inputs.")
    ] = None,
    outputs: Annotated[
        str | None, typer.Option(metavar="NAME", help="The variable with the outputs.")
    ] = None,
    calibration: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The variable with parameters and their checksum."),
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Write the addresses of a program into the file for calibration tools.

    Variables are found by their types. If several have the same type, an option names the right
    one: `controller`, or `vehicle.controller` for a member of a struct. Exit code 1 if the program
    does not have the structs of the export.
    """
    from backends.files.atomic_write import write_text
    from msnn.calibration import fill_addresses
    from msnn.cli.console import json_result, report, result
    from msnn.exports.export import spare_foreign_files

    named = {
        "params": params,
        "state": state,
        "in": inputs,
        "out": outputs,
        "calibration": calibration,
    }
    chosen = {struct: name for struct, name in named.items() if name is not None}
    found = fill_addresses(elf, export, chosen)
    report(found.warnings, ())
    if out is None:
        spare_foreign_files([elf.with_suffix(".a2l")])
    written = write_text(out or elf.with_suffix(".a2l"), found.text)
    if format is ResultFormat.JSON:
        taken = {
            struct: {"variable": instance.name, "address": instance.address}
            for struct, instance in found.instances.items()
        }
        json_result("a2l", {"file": str(written), "objects": found.objects, "instances": taken})
        return
    lines = [
        f"{instance.type:<32} {instance.name} at 0x{instance.address:X}"
        for instance in found.instances.values()
    ]
    result("\n".join([*lines, f"{found.objects} objects have their addresses in {written}"]))
