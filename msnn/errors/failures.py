"""Failures that are neither the spec's nor the data's: each ends a command with its own code."""

from __future__ import annotations

from collections.abc import Sequence

from msnn.errors.commands import compiler_failed, missing_extra, not_run_here
from spec_schema.diagnostics.diagnostic import Diagnostic, shown_whole


class ReaderGoneError(Exception):
    """Whoever reads our output has closed it: `msnn show … | head`."""


class VerbFaultError(Exception):
    """A mistake of a plug-in's verb, which its package has to repair."""


class MissingExtraError(Exception):
    """Something optional that a command needs is not installed."""

    def __init__(self, what: str, install: str, reason: str = "") -> None:
        self.diagnostic: Diagnostic = missing_extra(what, install, reason)
        super().__init__(self.diagnostic.message)
        self._made_of: tuple[object, ...] = (what, install, reason)

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[object, ...]]:
        """Crosses to another process as its arguments: a pool waits for ever on what cannot."""
        return type(self), self._made_of

    def _render_traceback_(self) -> list[str]:
        """Shows in a notebook the message and the line that installs it, not a traceback."""
        return shown_whole([self.diagnostic])


class MissingPluginError(MissingExtraError):
    """A file was made of a spec that uses a plug-in which is not installed, or not used here."""

    def __init__(
        self, package: str, version: str, file: str, reason: str = "", repair: str = ""
    ) -> None:
        what = f"the plug-in {package} {version}".strip() + f", which {file} needs,"
        fits = repair or f"install a version of {package} that fits this msnn"
        super().__init__(what, fits if reason else f"pip install {package}", reason)
        self._made_of = (package, version, file, reason, repair)


class UnfitCompilerError(MissingExtraError):
    """The C compiler that a command needs is installed, and does not build what it is given."""

    def __init__(self, compiler: str, said: Sequence[str], remedy: str) -> None:
        self.diagnostic = compiler_failed(compiler, said, remedy)
        # past the parent, whose sentence is that of what is not there
        Exception.__init__(self, self.diagnostic.message)
        self._made_of = (compiler, said, remedy)


class NotRunHereError(MissingExtraError):
    """An export was written, and what runs it on this machine does not run it."""

    def __init__(self, target: str, reason: str) -> None:
        self.diagnostic = not_run_here(target, reason)
        Exception.__init__(self, self.diagnostic.message)
        self._made_of = (target, reason)
