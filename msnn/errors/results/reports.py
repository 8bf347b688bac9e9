"""E0853 and W0809: reports of runs."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning


def not_verification(file: str) -> Diagnostic:
    """E0853: a file of results that `msnn verify` has not written."""
    message = f"{file} is not what `msnn verify --format json` writes"
    repair = "write it: `msnn verify build/export/c --format json -o verification.json`"
    return error("E0853", None, message, help=repair)


def no_part(part: str, reason: str, repair: str | None = None) -> Diagnostic:
    """W0809: a report that lacks a part."""
    message = f"the report has no {part}: {reason}"
    usual = "what it has is right all the same; mend the reason and write it again"
    return warning("W0809", None, message, help=repair or usual)
