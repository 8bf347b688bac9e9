"""Combines the commands of `msnn` to one application, and handles all errors."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import typer

from msnn.cli.exit_codes import ExitCode
from msnn.cli.interrupts import is_interrupt
from msnn.cli.output_options import NOW, forget_manners, terminal_width, with_manners
from msnn.cli.verb_group import VerbCommand, VerbGroup, plugin_with_verb
from msnn.errors.failures import ReaderGoneError, VerbFaultError
from msnn.tables import LINE_WIDTH
from spec_schema.errors.plugins import TRACEBACKS
from spec_schema.plugins import Plugin

VERBS = (
    "init",
    "import",
    "check",
    "data",
    "compile",
    "train",
    "validate",
    "compare",
    "sweep",
    "simulate",
    "export",
    "verify",
    "a2l",
    "show",
    "report",
    "explain",
    "schema",
    "diff",
    "fmt",
    "lsp",
    "doctor",
)
"""In the order of `msnn --help`; each is a function in a file of its name."""
_MODULES = {"import": "import_"}
"""Modules of commands whose names are Python keywords."""
_FUNCTIONS = {"import": "import_", "compile": "compile_"}
"""Functions of commands whose names are Python keywords or built-ins."""


def application(verbs: Sequence[str] = VERBS) -> typer.Typer:
    """The typer application of the command line, with these commands.

    A single command is faster: parsing the options of all takes longer than `check`.
    """
    app = typer.Typer(
        name="msnn",
        cls=VerbGroup,
        help="Model-structured neural networks: check, train, validate and export a spec.",
        epilog="Exit codes: 0 fine, 1 spec or data wrong, 2 command line wrong, 3 limit broken, "
        "4 training diverged, 5 something optional missing, 70 a bug in msnn or a plug-in, "
        "130 interrupted.",
        # plain text: markup would eat `[t+1]`, and rich would cost start-up time
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for name in verbs:
        # verbs import what they work with inside their functions, so that this loads options alone
        module = import_module(f"msnn.cli.verbs.{_MODULES.get(name, name)}")
        verb = getattr(module, _FUNCTIONS.get(name, name))
        app.command(name, cls=VerbCommand)(with_manners(verb))
    return app


def _print_version(wanted: bool) -> None:
    if wanted:
        from spec_schema.version import __version__

        print(f"msnn {__version__}")
        raise typer.Exit


def _options(
    version: bool = typer.Option(
        False, "-V", "--version", help="Print the version.", callback=_print_version, is_eager=True
    ),
) -> None:
    del version


def run(arguments: Sequence[str]) -> int:
    """Runs one command with these arguments; returns its exit code. All exceptions are handled, and
    reported to stderr.
    """
    began = time.monotonic()
    forget_manners()
    TRACEBACKS.clear()
    LINE_WIDTH.set(terminal_width())
    code = _ended(arguments)
    NOW.outputs.forget()
    # after a wrong command line or a bug there is no log: an empty one would read as "nothing
    # found"
    if NOW.messages == "sarif" and code not in (ExitCode.USAGE, ExitCode.BUG):
        _tell_kept_messages()
    # a command that failed before it said anything leaves the file as it was
    says = NOW.results or code == ExitCode.OK
    if NOW.output is not None and says and code not in (ExitCode.USAGE, ExitCode.BUG):
        # a file that cannot be written fails a command that went well, and hides no worse end of
        # another
        code = max(code, _ended_writing(NOW.output, NOW.results))
    if NOW.is_verbose:
        print(*TRACEBACKS, sep="", end="", file=sys.stderr)
        print(f"took {time.monotonic() - began:.2f} s", file=sys.stderr)
    return code


def _ended_writing(path: Path, results: Sequence[str]) -> int:
    """Writes the results to the file of `-o`, even if they report errors. Returns OK, or the exit
    code of a file that cannot be written, which is reported.
    """
    from backends.files.atomic_write import write_text

    try:
        write_text(path, "".join(f"{text}\n" for text in results))
    except OSError as error:
        from msnn.cli.console import answer

        return answer(error)
    return ExitCode.OK


def _ended(arguments: Sequence[str]) -> int:
    try:
        application(_needed(arguments))(list(arguments), prog_name="msnn")
    # typer ends every command so, with its code; an interrupt inside of a callback comes as one too
    except SystemExit as end:
        if is_interrupt(end):
            return _tell_of_interrupt()
        return _code_of(end)
    except KeyboardInterrupt:
        return _tell_of_interrupt()
    # `msnn show … | head` has got what it wanted: no failure, as for other tools of a shell
    except ReaderGoneError:
        _write_no_more()
        return ExitCode.OK
    except Exception as error:  # noqa: BLE001  (the one place that answers for every failure)
        # a library that was interrupted may raise an error of its own, which then is no bug
        if is_interrupt(error):
            return _tell_of_interrupt()
        from msnn.cli.console import answer

        code = answer(error)
        if code is ExitCode.BUG:
            _tell_of_bug(error, arguments)
        return code
    return ExitCode.OK


def _code_of(end: SystemExit) -> int:
    """The exit code as Python defines it; a message of `sys.exit(message)` goes to stderr."""
    if end.code is None:
        return ExitCode.OK
    if isinstance(end.code, int):
        # the system keeps the last byte, and 256 would be success
        return end.code if 0 <= end.code < 256 else ExitCode.DIAGNOSTICS
    from spec_schema.diagnostics.source import printable

    print(printable(str(end.code)), file=sys.stderr)
    return ExitCode.DIAGNOSTICS


def _needed(arguments: Sequence[str]) -> Sequence[str]:
    """The commands to load: the one that the arguments name, none for a plug-in's, all commands if
    it is unknown, for `--help` and "did you mean".
    """
    first = "".join(arguments[:1])
    if first in VERBS:
        return (first,)
    return () if _plugin_of(arguments) else VERBS


def _plugin_of(arguments: Sequence[str]) -> Plugin | None:
    """The plug-in that brings the command in these arguments; None for msnn's own and unknown
    commands.
    """
    first = "".join(arguments[:1])
    is_ours = not first or first.startswith("-") or first in VERBS
    return None if is_ours else plugin_with_verb(first)


def _tell_kept_messages() -> None:
    """Prints the SARIF log of a command that ended by an error, with that error."""
    from msnn.cli.console import sarif_result

    try:
        sarif_result()
    except ReaderGoneError:
        _write_no_more()


def _write_no_more() -> None:
    """Redirects stdout to the null device, so that the end of the process prints no error for a
    closed pipe.
    """
    # the interpreter flushes stdout as it ends, which would fail once more and print a traceback
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell_of_interrupt() -> ExitCode:
    print("interrupted", file=sys.stderr)
    return ExitCode.INTERRUPTED


def _tell_of_bug(error: Exception, arguments: Sequence[str]) -> None:
    # a plug-in's verb may fail before its options are read
    if NOW.is_verbose or not {"-v", "--verbose"}.isdisjoint(arguments):
        traceback.print_exception(error)
    from spec_schema.diagnostics.source import printable

    kind = "" if isinstance(error, VerbFaultError) else f"{type(error).__name__}: "
    said = f"({kind}{printable(str(error))}); `--verbose` shows where"
    plugin = _plugin_of(arguments)
    if plugin is None:
        print(f"msnn met a mistake of its own {said}, please report it", file=sys.stderr)
    else:
        package = f"{plugin.package} {plugin.version}".strip()
        print(
            f"the verb `{arguments[0]}` of the plug-in {package} failed {said}, please report it "
            f"to the authors of {plugin.package}",
            file=sys.stderr,
        )
