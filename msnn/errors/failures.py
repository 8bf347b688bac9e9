"""Failures that are neither the spec's nor the data's: each ends a command with its own code."""

from __future__ import annotations

from msnn.errors.commands import missing_extra
from spec_schema.diagnostics.diagnostic import Diagnostic, shown_whole


class ReaderGoneError(Exception):
    """Whoever reads our output has closed it: `msnn show … | head`."""


class MissingExtraError(Exception):
    """Something optional that a command needs is not installed."""

    def __init__(self, what: str, install: str) -> None:
        self.diagnostic: Diagnostic = missing_extra(what, install)
        super().__init__(self.diagnostic.message)
        self._made_of = (what, install)

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        """Crosses to another process as its arguments: a pool waits for ever on what cannot."""
        return MissingExtraError, self._made_of

    def _render_traceback_(self) -> list[str]:
        """Shows in a notebook the message and the line that installs it, not a traceback."""
        return shown_whole([self.diagnostic])
