"""`msnn verify`: proves exported C on this machine, in QEMU, and by analysis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from msnn.cli.arguments import OutputFormat, ResultFormat, words_of
from msnn.cli.exit_codes import ExitCode
from msnn.verification.on_board.link import FORMS, Link, Ram, link_of, ram_of


def verify(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="What `msnn export --to c` or `--to mpc` wrote: build/export/c."
        ),
    ],
    targets: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET,…",
            help="host, m4, m7, m0, rv32 or all; default: host; boards run in QEMU.",
        ),
    ] = None,
    proof: Annotated[
        bool,
        typer.Option(
            "--proof", help="Prove that no step has a run-time error for inputs but NaN (Frama-C)."
        ),
    ] = False,
    misra: Annotated[
        bool, typer.Option("--misra", help="Run the MISRA addon of cppcheck.")
    ] = False,
    fuzz: Annotated[
        int, typer.Option(metavar="SECONDS", min=0, help="Let libFuzzer try any state and input.")
    ] = 0,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="A real board: openocd:CFG, pyocd:ID, serial:PORT, gdb:HOST:PORT."
        ),
    ] = None,
    ram: Annotated[
        str,
        typer.Option(metavar="ADDRESS:BYTES", help="What of its RAM a debugger may fill."),
    ] = "0x20000000:65536",
    serve: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Only write what firmware needs for serial:PORT."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where the report goes; default: DIR/REPORT.md."),
    ] = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Verify exported C.

    Strict builds, golden vectors of the interpreter to the bit and the code that they cover,
    sanitizers. Boards in QEMU also measure instructions, memory and stack of a step, a real one
    cycles. A controller and its filter are checked by golden solves, and by calls with random
    numbers and NaN. Exit code 1 if anything is found, 5 if a tool is missing or did not end; the
    other checks still run.
    """
    from backends.files.atomic_write import write_text
    from msnn.cli.console import json_result, note, result
    from msnn.verification.report import (
        verification_markdown,
        verification_text,
        verification_values,
    )
    from msnn.verification.verify import TARGETS, WantedSteps, write_serve_files
    from msnn.verification.verify import verify as verify_export

    names = ["host"] if targets is None else words_of(targets)
    for name in names:
        if name not in (*TARGETS, "all"):
            message = f"`{name}` is none of {', '.join(TARGETS)} and all"
            raise typer.BadParameter(message, param_hint="'--targets'")
    chosen = frozenset(TARGETS if "all" in names else names)
    wanted = WantedSteps(
        targets=chosen, proof=proof, misra=misra, fuzz=fuzz, board=_link(board), ram=_ram(ram)
    )
    # firmware is built by the user's own tools: nothing is verified until it answers at a port
    if serve is not None:
        for path in write_serve_files(folder, serve):
            result(str(path))
        return
    if wanted.is_empty:
        message = "nothing is left to check: name a target, or ask for --proof, --misra or --fuzz"
        raise typer.BadParameter(message, param_hint="'--targets'")
    found = verify_export(folder, wanted)
    written = write_text(report or folder / "REPORT.md", verification_markdown(found))
    if format is ResultFormat.JSON:
        json_result("verify", verification_values(found))
    else:
        result(verification_text(found))
    note(f"report: {written}")
    if found.missing:
        note(f"missing: {found.install_line}")
    # a fault that was found outweighs a tool that is missing
    if found.found:
        raise typer.Exit(ExitCode.DIAGNOSTICS)
    if found.missing or found.undone:
        raise typer.Exit(ExitCode.MISSING_EXTRA)


def _link(text: str | None) -> Link | None:
    if text is None:
        return None
    found = link_of(text)
    if found is None:
        raise typer.BadParameter(f"`{text}` is none of {FORMS}", param_hint="'--board'")
    return found


def _ram(text: str) -> Ram:
    found = ram_of(text)
    if found is None:
        message = f"`{text}` is no ADDRESS:BYTES whose address is a multiple of 512"
        raise typer.BadParameter(message, param_hint="'--ram'")
    return found
