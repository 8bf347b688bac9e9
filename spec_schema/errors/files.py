"""E1001, E1050-E1059: files that cannot be read, and what `msnn compile` wrote into them."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error

_REPAIR = "write it again with `msnn compile`"


def unreadable_file(path: str, reason: str) -> Diagnostic:
    """E1001: a file that cannot be read."""
    return error("E1001", None, f"cannot read {path}: {reason}")


def not_a_program(name: str, reason: str) -> Diagnostic:
    """E1050: a file that is not the JSON of a program."""
    message = f"{name} is not a program file: {reason}"
    return error("E1050", None, message, help=_REPAIR)


def other_format(name: str, found: int, known: int) -> Diagnostic:
    """E1051: a program file of another version."""
    message = f"{name} has format {found}; this version reads format {known}"
    return error("E1051", None, message, help=_REPAIR)


def illegal_program(name: str, reason: str) -> Diagnostic:
    """E1052: a program file whose program breaks a rule of the IR."""
    message = f"{name} holds no legal program: {reason}"
    return error("E1052", None, message, help=_REPAIR)
