"""E10xx: files, the command line and missing extras."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def unreadable_file(path: str, reason: str) -> Diagnostic:
    """E1001: a file that cannot be read."""
    return error("E1001", None, f"cannot read {path}: {reason}")
