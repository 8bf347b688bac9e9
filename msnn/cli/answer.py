"""Converts exceptions of a command to messages and an exit code."""

from __future__ import annotations

from msnn.cli.console import note, report
from msnn.cli.exit_codes import ExitCode
from msnn.errors.commands import refused_by_system
from msnn.errors.failures import MissingExtraError
from spec_schema.diagnostics.diagnostic import SpecError


def answer(error: Exception) -> ExitCode:
    """Prints the error to stderr; returns BUG without a message for unexpected exceptions."""
    match error:
        case SpecError():
            report(error.diagnostics, error.sources)
            return ExitCode.DIAGNOSTICS
        case MissingExtraError():
            report([error.diagnostic], ())
            return ExitCode.MISSING_EXTRA
        case OSError():
            # no path where the failing call knew none: a socket, a pipe, or a library that keeps
            # only strerror
            path = "" if error.filename is None else str(error.filename)
            report([refused_by_system(path, (error.strerror or str(error)).lower())], ())
            return ExitCode.DIAGNOSTICS
        # told as the user's to cure, not as a bug: what does not fit is decided by the spec and the
        # data
        case MemoryError():
            note("out of memory: a smaller `batch` or fewer rows at once may fit")
            return ExitCode.DIAGNOSTICS
        case _:
            return ExitCode.BUG
