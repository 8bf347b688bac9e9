"""Adds the common options to every command: verbosity, and the output file."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from stat import S_ISREG
from typing import Annotated, Any, Literal, cast

import typer

from msnn.tables import LINE_WIDTH
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.late_dataclass import dataclass

_WRITES = os.O_WRONLY | os.O_RDWR


class Outputs:
    """The existing files that the running command will replace or extend.

    Raises BadParameter when the command opens one of them for reading: a Python audit hook observes
    every opened file. A reader in C or in another process reports its file with `sys.audit("open",
    path, "r", os.O_RDONLY)`.
    """

    def __init__(self) -> None:
        self._files: dict[tuple[int, int], Path] = {}
        self._is_watching = False

    def __bool__(self) -> bool:
        """True if an existing file may be overwritten."""
        return bool(self._files)

    def forget(self) -> None:
        """Empties the list of files after a command; the files on disk stay as they are."""
        self._files.clear()

    def protect(self, *outputs: Path) -> None:
        """Adds files that the command will write. Raises BadParameter for duplicates and for files
        of a run.
        """
        new = [path.absolute() for path in outputs if not path.exists()]
        if twice := [path for path in new if new.count(path) > 1]:
            raise typer.BadParameter(f"`{twice[0]}` would be written twice")
        for path in outputs:
            # neither a folder, into which much is written, nor a device or a pipe
            if (identity := _identity(path)) is None:
                continue
            if identity in self._files:
                raise typer.BadParameter(f"`{path}` would be written twice")
            if _is_of_run(path.resolve()):
                raise typer.BadParameter(f"`{path}` belongs to a run and would be overwritten")
            self._files[identity] = path
        if self._files and not self._is_watching:
            # for as long as the process lives: Python has no way to remove one
            sys.addaudithook(self._opened)
            self._is_watching = True

    def spare(self, read: Iterable[Path]) -> None:
        """Raises BadParameter if the command would overwrite one of these files, which it reads."""
        for path in read if self._files else ():
            written = self._files.get(_identity(path) or (0, 0))
            if written is not None:
                raise typer.BadParameter(f"`{written}` is read here and would be overwritten")

    def _opened(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and self._files:
            path, _, flags = arguments
            if isinstance(path, str | bytes | os.PathLike) and not flags & _WRITES:
                self.spare([Path(os.fsdecode(cast("str", path)))])


def _identity(path: Path) -> tuple[int, int] | None:
    """The device and inode numbers of a regular file; None for folders, devices and paths that do
    not exist.
    """
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if S_ISREG(found.st_mode) else None


def _is_of_run(path: Path) -> bool:
    from msnn.model.saved_run import is_kept

    return is_kept(path)


Messages = Literal["full", "concise", "github", "sarif"]
"""Format of messages: text, GitHub annotations, or one SARIF log."""


@dataclass(slots=True)
class Manners:
    """The values of the options that every command has, `-q`, `-v`, `-o` and `--format`, for the
    running command.
    """

    is_quiet: bool = False
    is_verbose: bool = False
    is_silent: bool = False
    """True if another process prints the messages, including errors."""
    output: Path | None = None
    results: list[str] = field(default_factory=list[str])
    """Results, written to `output` when the command ends."""
    messages: Messages = "full"
    outputs: Outputs = field(default_factory=Outputs)
    """The files that options of the command replace or extend."""
    data_root: Path | None = None
    kept: list[Diagnostic] = field(default_factory=list[Diagnostic])
    """Messages for the SARIF log, which is then the only result."""


# global, as what prints is called from everywhere; `forget_manners` keeps commands of one process
# apart
NOW = Manners()
"""The options of the one running command."""


# in place, as others have imported NOW: a new object would leave them with the old one
def forget_manners() -> None:
    """Resets the common options to their defaults before a command."""
    NOW.is_quiet, NOW.is_verbose, NOW.output = False, False, None
    NOW.messages, NOW.is_silent = "full", False
    NOW.data_root = None
    NOW.results.clear()
    NOW.kept.clear()


def terminal_width() -> int | None:
    """Width of the terminal in characters, the maximum for tables; None if stdout is not a
    terminal.
    """
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
"""The added parameters of commands."""

STANDARD_OUTPUT = Path("-")
"""Standard output, as in other tools."""

_OWN_PLACES = {"out", "output"}
"""Parameters of commands that name the output themselves."""

WRITTEN = {*_OWN_PLACES, "write_to", "plot", "junit", "summary", "json", "report"}
"""Parameters of commands that name replaced or extended files."""


def with_manners(verb: Callable[..., None]) -> Callable[..., None]:
    """A copy of a command's function with the options `-q`, `-v` and `-o`; without `-o` if it has
    an output option itself.

    The copy sets NOW. It raises BadParameter if the command would overwrite a file that it reads.
    """
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
    """The paths among the values of the options `names`, in order; `arguments` are all options by
    name.
    """
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
