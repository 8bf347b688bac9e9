"""W0222: plug-ins."""

from spec_schema.diagnostics.diagnostic import Diagnostic, warning


def left_out(package: str, part: str, reason: str, repair: str) -> Diagnostic:
    """W0222: a plug-in, or one of its names, that is left out."""
    message = f"{part} of the package {package} is left out: {reason}"
    return warning("W0222", None, message, help=repair)
