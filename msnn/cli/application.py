"""The verbs of `msnn` as one application, and what becomes of all that can go wrong in one."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence

import typer

from msnn.cli.exit_codes import ExitCode
from msnn.cli.interrupts import is_interrupt
from msnn.cli.verbs import (
    check,
    compare,
    compile,
    data,
    diff,
    doctor,
    explain,
    export,
    fmt,
    init,
    schema,
    show,
    simulate,
    train,
    validate,
    verify,
)
from msnn.errors.failures import ReaderGoneError

app = typer.Typer(
    name="msnn",
    help="Model-structured neural networks: check, train, validate and export a spec.",
    epilog="Exit codes: 0 fine, 1 spec or data wrong, 2 command line wrong, 3 limit broken, "
    "4 training diverged, 5 something optional missing, 70 a bug in msnn, 130 interrupted.",
    # plain text: markup would eat `[t+1]`, and rich would cost start-up time
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _verb in (
    init.init,
    check.check,
    data.data,
    compile.compile_,
    train.train,
    validate.validate,
    compare.compare,
    simulate.simulate,
    export.export,
    verify.verify,
    show.show,
    explain.explain,
    schema.schema,
    diff.diff,
    fmt.fmt,
    doctor.doctor,
):
    app.command(_verb.__name__.rstrip("_"))(_verb)


def _print_version(wanted: bool) -> None:
    if wanted:
        from spec_schema.version import __version__

        print(f"msnn {__version__}")
        raise typer.Exit


@app.callback()
def _options(  # pyright: ignore[reportUnusedFunction]
    version: bool = typer.Option(
        False, "--version", help="Print the version.", callback=_print_version, is_eager=True
    ),
) -> None:
    del version


def run(arguments: Sequence[str]) -> int:
    """Runs one command; returns its exit code and never raises."""
    try:
        app(list(arguments), prog_name="msnn")
    except SystemExit as end:
        if is_interrupt(end):
            return _tell_of_interrupt()
        return end.code if isinstance(end.code, int) else ExitCode.OK
    except KeyboardInterrupt:
        return _tell_of_interrupt()
    except ReaderGoneError:
        # nothing may be written when the process ends either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.OK
    except Exception as error:  # noqa: BLE001  (the one place that answers for every failure)
        if is_interrupt(error):
            return _tell_of_interrupt()
        from msnn.cli.answer import answer

        code = answer(error)
        if code is ExitCode.BUG:
            _tell_of_bug(error)
        return code
    return ExitCode.OK


def _tell_of_interrupt() -> ExitCode:
    print("interrupted", file=sys.stderr)
    return ExitCode.INTERRUPTED


def _tell_of_bug(error: Exception) -> None:
    if os.environ.get("MSNN_TRACEBACK"):
        traceback.print_exception(error)
        return
    print(
        f"msnn met a mistake of its own ({type(error).__name__}: {error}); "
        "MSNN_TRACEBACK=1 shows where, please report it",
        file=sys.stderr,
    )
