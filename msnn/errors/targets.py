"""E1301-E1307, E1320-E1327, W1301, W1302: boards, addresses and engines of exported code."""

from __future__ import annotations

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning


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


def no_calibrated_export(folder: str) -> Diagnostic:
    """E1302: a folder without one ASAP2 file and its description of the C."""
    message = f"{folder} does not hold the `.a2l` and the `.json` of one export"
    repair = "name the folder that `msnn export --to c` wrote: `--export build/export/c`"
    return error("E1302", None, message, help=repair)


def no_debug_information(path: str, reason: str) -> Diagnostic:
    """E1303: a file that does not say where variables lie."""
    repair = "compile and link with `-g`, and name the linked file, before it is stripped"
    return error("E1303", None, f"{path} names no variables: {reason}", help=repair)


def several_instances(type: str, names: Sequence[str], option: str) -> Diagnostic:
    """E1304: more than one variable of a struct of the export."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"several variables are a `{type}`: {listed}"
    return error("E1304", None, message, help=f"say which one by `{option} NAME`")


def no_such_instance(name: str, type: str, names: Sequence[str]) -> Diagnostic:
    """E1305: a variable that is not there, or is none of the struct."""
    there = ", ".join(f"`{name}`" for name in names) or "no variable with a fixed address is"
    return error("E1305", None, f"`{name}` is no `{type}`", help=f"one is: {there}")


def other_layout(member: str, reason: str) -> Diagnostic:
    """E1306: a struct of the ELF file that is not that of the export."""
    message = f"`{member}` {reason}"
    repair = "the file was built from another export: build it from this one again"
    return error("E1306", None, message, help=repair)


def no_instances(path: str, types: Sequence[str]) -> Diagnostic:
    """E1307: no variable of any struct of the export."""
    listed = ", ".join(f"`{type}`" for type in types)
    message = f"{path} has no variable with a fixed address of {listed}"
    repair = "variables on a stack have none: make them static or global"
    return error("E1307", None, message, help=repair)


def other_image(path: str, there: str, wanted: str) -> Diagnostic:
    """E1327: an ELF file with the C of another export."""
    message = f"{path} holds the export {there[:12]}, the folder is {wanted[:12]}"
    repair = "build it from this folder again, or name the folder that it was built from"
    return error("E1327", None, message, help=repair)


def without_address(type: str, count: int) -> Diagnostic:
    """W1302: a struct of which there is no variable with a fixed address."""
    objects = "object keeps" if count == 1 else "objects keep"
    message = f"no variable with a fixed address is a `{type}`: {count} {objects} the address 0"
    return warning("W1302", None, message, help="variables on a stack have none: make one static")


def engine_of_words(dtype: str) -> Diagnostic:
    """E1301: data to be run through C that computes in fixed point."""
    message = f"`export: c` says `dtype: {dtype}`, and data have numbers with units, not words"
    repair = "add `--set export.c.dtype=float32`; `msnn export --check` runs C in fixed point"
    return error("E1301", None, message, help=repair)


def losses_are_interpreted(engine: str) -> Diagnostic:
    """W1301: a loss to be measured of an export, which has outputs and no losses."""
    message = f"losses are computed by the interpreter: the engine `{engine}` has outputs alone"
    return warning("W1301", None, message)
