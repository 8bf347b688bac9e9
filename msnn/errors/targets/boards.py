"""E1320-E1325: the board on which exported C is verified."""

from __future__ import annotations

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def unreachable(link: str, reason: str, said: Sequence[str] = ()) -> Diagnostic:
    """E1320: no gdb server or serial line where `--board` leads."""
    repair = (
        "gdb: a server must listen there; openocd and pyocd: a probe must be plugged in; serial: "
        "the line must be there, and yours to read"
    )
    return error("E1320", None, f"cannot reach {link}: {reason}", help=repair, notes=tuple(said))


def silent(link: str, reason: str) -> Diagnostic:
    """E1321: a board that does not answer as it should."""
    repair = (
        "reset the board; a serial line needs firmware with what `--serve FOLDER` writes, at the "
        "same speed"
    )
    return error("E1321", None, f"{link} does not answer: {reason}", help=repair)


def refused_memory(link: str, address: int) -> Diagnostic:
    """E1322: a board whose memory does not take the program."""
    message = f"{link} does not take a program: nothing can be kept at 0x{address:08x}"
    return error("E1322", None, message, help="say where its RAM is: `--ram ADDRESS:BYTES`")


def no_room(model: str, needed: int, there: int) -> Diagnostic:
    """E1323: a memory that is too small for the golden vectors."""
    message = f"`{model}` and its golden vectors need {needed} bytes of RAM, and {there} are given"
    repair = (
        "give more by `--ram ADDRESS:BYTES`, or let firmware with what `--serve FOLDER` writes "
        "keep them in flash: `--board serial:PORT`"
    )
    return error("E1323", None, message, help=repair)


def unknown_core(link: str, identity: int | None) -> Diagnostic:
    """E1324: a core for which no program can be built."""
    told = "it has no CPUID" if identity is None else f"its CPUID is 0x{identity:08x}"
    message = f"{link} leads to a core that is not known: {told}"
    repair = (
        "known are Cortex-M0, M0+, M3, M4, M7, M23 and M33; others are asked on a serial line: "
        "`--board serial:PORT`"
    )
    return error("E1324", None, message, help=repair)


def no_controller_on_board(name: str) -> Diagnostic:
    """E1325: a controller, of which a board has no golden solves to replay."""
    message = f"`{name}` is a controller, and a board replays the steps of models alone"
    repair = (
        "leave `--board` and `--serve` out: `--targets m4` runs its golden solves on a core in QEMU"
    )
    return error("E1325", None, message, help=repair)
