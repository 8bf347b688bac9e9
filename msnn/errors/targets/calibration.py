"""E1302-E1307, E1327, W1302: addresses of exported C in an ELF file."""

from __future__ import annotations

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning


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
