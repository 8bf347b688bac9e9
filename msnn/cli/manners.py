"""Gives every verb the options that all have: how much it says, and where its result goes."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer

from msnn.cli.outputs import Outputs
from msnn.tables import LINE_WIDTH
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.late_dataclass import dataclass

Messages = Literal["full", "concise", "github", "sarif"]
"""How messages are told: as text, as annotations of GitHub, or kept for one log of SARIF."""


@dataclass(slots=True)
class Manners:
    """The options of the running command that say how it speaks."""

    is_quiet: bool = False
    is_verbose: bool = False
    is_silent: bool = False
    """Whether another process speaks for this one: not even errors are told."""
    output: Path | None = None
    results: list[str] = field(default_factory=list[str])
    """What goes to `output` when the command is over."""
    messages: Messages = "full"
    outputs: Outputs = field(default_factory=Outputs)
    """The files that its options replace or add to."""
    data_root: Path | None = None
    kept: list[Diagnostic] = field(default_factory=list[Diagnostic])
    """Messages of the log of SARIF, which is the only result then."""


# global, as what prints is called from everywhere; `forget_manners` keeps commands of one process
# apart
NOW = Manners()
"""Of the one command that this process runs."""


# in place, as others have imported NOW: a new object would leave them with the old one
def forget_manners() -> None:
    """Before a command: as if no option had been given."""
    NOW.is_quiet, NOW.is_verbose, NOW.output = False, False, None
    NOW.messages, NOW.is_silent = "full", False
    NOW.data_root = None
    NOW.results.clear()
    NOW.kept.clear()


def terminal_width() -> int | None:
    """Columns that tables may take; None where no terminal shows them."""
    # asked for only of a terminal: without one it answers COLUMNS or 80, and files would be cut to
    # that
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


_Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say results and errors alone.")]
_Verbose = Annotated[
    bool,
    typer.Option(
        "-v", "--verbose", help="Say remarks too, the time it took, and where a bug of msnn is."
    ),
]
_Output = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="FILE", help="Write the result to a file; default: stdout."
    ),
]
ADDED = ("be_quiet", "be_verbose", "write_to")
"""The parameters that verbs get."""

STANDARD_OUTPUT = Path("-")
"""As `-o` of other tools has it."""

_OWN_PLACES = {"out", "output"}
"""Parameters of verbs that have a place of their own for what they write."""

WRITTEN = {*_OWN_PLACES, "write_to", "plot", "junit", "summary", "json", "report"}
"""Parameters of verbs that name what is replaced or added to."""


def with_manners(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with `-q`, `-v`, and `-o` where its own options name no place to write to."""
    # typer reads the types of options, which `from __future__ import annotations` leaves as texts
    own = signature(verb, eval_str=True)
    options: dict[str, tuple[Any, bool | None]] = {
        "be_quiet": (_Quiet, False),
        "be_verbose": (_Verbose, False),
    }
    if not _OWN_PLACES & own.parameters.keys():
        options["write_to"] = (_Output, None)

    # typer takes help and name from what wraps copies
    @wraps(verb)
    def mannered(**arguments: Any) -> None:
        written, read = _paths(arguments, WRITTEN), _paths(arguments, arguments.keys() - WRITTEN)
        NOW.outputs.protect(*written)
        NOW.outputs.spare(read)
        NOW.data_root = arguments.get("data_root")
        asked = [arguments.pop(option) for option in options]
        _behave(*asked)
        verb(**arguments)

    added = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (annotation, default) in options.items()
    ]
    # keywords alone: parameters without a default could else not stand behind those with one
    parameters = [p.replace(kind=Parameter.KEYWORD_ONLY) for p in own.parameters.values()]
    # inspect follows __wrapped__ to the verb's own signature unless there is this one; typer reads
    # types from __annotations__
    mannered.__signature__ = Signature([*parameters, *added])  # pyright: ignore[reportAttributeAccessIssue]
    mannered.__annotations__ = {p.name: p.annotation for p in (*parameters, *added)}
    return mannered


def _paths(arguments: Mapping[str, object], names: Iterable[str]) -> list[Path]:
    """The paths among values of options, in their order."""
    chosen = [arguments[name] for name in arguments if name in set(names)]
    several = [cast("list[object]", one) if isinstance(one, list) else [one] for one in chosen]
    return [path for each in several for path in each if isinstance(path, Path)]


def _behave(is_quiet: bool, is_verbose: bool, output: Path | None = None) -> None:
    if is_quiet and is_verbose:
        raise typer.BadParameter("excludes `--verbose`", param_hint="'--quiet'")
    NOW.is_quiet, NOW.is_verbose = is_quiet, is_verbose
    # a file gets whole tables, however wide the terminal is
    if output not in (None, STANDARD_OUTPUT):
        NOW.output = output
        LINE_WIDTH.set(None)
