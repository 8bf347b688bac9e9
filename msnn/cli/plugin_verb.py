"""Tells mistakes of a plug-in's verb from those of its user, and gives its return value a code."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from traceback import walk_tb
from typing import Any, cast

import typer

from msnn.cli.exit_codes import ExitCode
from msnn.cli.output_options import ADDED
from msnn.errors.failures import VerbFaultError
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.plugins import fault_of_refusal

_OURS = {"spec_schema", "compiler", "backends", "msnn"}
_OF_THE_SYSTEM = {errno.ENOSPC, errno.EDQUOT, errno.EPIPE}
"""A full disk and a reader that is gone are no mistakes of a verb."""


def guarded_verb(verb: Callable[..., object], module: str) -> Callable[..., None]:
    """The verb of a plug-in's module. It ends with the `ExitCode` that the function returns.

    Raises VerbFaultError for another value, for a SpecError without an error, and for an OSError or
    MemoryError of the plug-in's own code that no path of the command line explains.
    """

    @wraps(verb)
    def run(**arguments: Any) -> None:
        try:
            code = verb(**arguments)
        except SpecError as error:
            reason = fault_of_refusal(error)
            if reason is not None:
                raise VerbFaultError(reason) from error
            raise
        except (OSError, MemoryError) as error:
            if _is_of_plugin(error, module, arguments):
                reason = f": {error}" if str(error) else ""
                raise VerbFaultError(f"{type(error).__name__}{reason}") from error
            raise
        if code is None:
            return
        if isinstance(code, bool) or not isinstance(code, int) or code not in set(ExitCode):
            wanted = "return an `ExitCode` or nothing, and print a result by `result`"
            raise VerbFaultError(f"returned a {type(code).__name__}: {wanted}")
        raise typer.Exit(code)

    return run


def refuse_twin_options(command: Any) -> None:
    """Raises VerbFaultError if two parameters of a command, or of one below it, share an option."""
    for below in getattr(command, "commands", {}).values():
        refuse_twin_options(below)
    owners: dict[str, str] = {}
    for parameter in sorted(command.params, key=lambda each: each.name not in ADDED):
        for option in (*parameter.opts, *parameter.secondary_opts):
            if parameter.param_type_name == "option" and option in owners:
                of = "every verb" if owners[option] in ADDED else f"`{owners[option]}`"
                raise VerbFaultError(
                    f"its parameter `{parameter.name}` has the option `{option}` of {of}: rename it"
                )
            owners[option] = parameter.name


def _is_of_plugin(
    error: OSError | MemoryError, module: str, arguments: Mapping[str, object]
) -> bool:
    frames = (str(frame.f_globals.get("__name__")) for frame, _ in walk_tb(error.__traceback__))
    known = {*_OURS, module.partition(".")[0]}
    packages = [name for name in (each.partition(".")[0] for each in frames) if name in known]
    if packages and packages[-1] in _OURS:
        return False
    if isinstance(error, MemoryError):
        return True
    if error.errno in _OF_THE_SYSTEM:
        return False
    given = {Path(path).absolute() for path in _paths(arguments.values())}
    failed = [Path(str(each)).absolute() for each in (error.filename, error.filename2) if each]
    return not any(
        path.is_relative_to(own) or own.is_relative_to(path) for path in failed for own in given
    )


def _paths(values: Iterable[object]) -> Iterator[str | Path]:
    for value in values:
        if isinstance(value, list | tuple):
            yield from _paths(cast("Iterable[object]", value))
        elif isinstance(value, str | Path):
            yield value
