"""Defines the exit codes of commands."""

from enum import IntEnum


class ExitCode(IntEnum):
    """The exit codes of `msnn`; they are stable, because scripts and pipelines rely on them."""

    OK = 0
    DIAGNOSTICS = 1
    """The spec or the data are wrong, or a file cannot be written."""
    USAGE = 2
    """The command line is wrong."""
    LIMIT_BROKEN = 3
    """A limit of `validate` is broken."""
    DIVERGED = 4
    """Training met a non-finite value."""
    MISSING_EXTRA = 5
    """An optional package or a compiler is not installed."""
    BUG = 70
    """An error in msnn itself."""
    INTERRUPTED = 130
    """The user ended the command."""
