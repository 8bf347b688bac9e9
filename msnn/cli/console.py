"""Prints the output of a command: results to stdout, messages and progress to stderr."""

from __future__ import annotations

import io
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TextIO, cast

from msnn.cli.exit_codes import ExitCode
from msnn.cli.output_options import NOW
from msnn.errors.commands import refused_by_system
from msnn.errors.failures import MissingExtraError, ReaderGoneError
from msnn.tables import is_live
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.render import render
from spec_schema.diagnostics.source import SourceText, printable, printable_json

if TYPE_CHECKING:
    from msnn.model.model import Model


# `msnn.model` loads the compiler, which `fmt`, `explain` and `schema` do without

JSON_VERSION = 1
"""Version of `--format json`; incremented for incompatible changes."""


def result(text: str) -> None:
    """Writes the result to stdout, or at the end of the command to the file of `-o`.

    Writes nothing if the result is a SARIF log. Raises ReaderGoneError if the reader of a pipe has
    ended, OSError if it cannot be written.
    """
    if NOW.messages != "sarif":
        _written(text)


def sarif_result() -> None:
    """Writes the log of all diagnostics as the result with `--format sarif`; nothing in other
    formats.
    """
    if NOW.messages == "sarif":
        _written(render(NOW.kept, "sarif"))


def _written(text: str) -> None:
    if NOW.output is None:
        _say(text, sys.stdout)
    else:
        NOW.results.append(text)


def json_result(command: str, content: dict[str, Any]) -> None:
    """Writes `content` as the JSON result of `command`, with the version of the format."""
    result(json_text(command, content))


def json_text(command: str, content: dict[str, Any]) -> str:
    """The result `content` of `command` as JSON text with the version of the format; NaN and
    infinity become null.
    """
    record = {"version": JSON_VERSION, "command": command, **content}
    text = json.dumps(plain(record), ensure_ascii=False, indent=2, allow_nan=False)
    return printable_json(text)


def note(text: str) -> None:
    """Prints a hint to stderr in one line; nothing with `--quiet`."""
    if not NOW.is_quiet:
        _say(printable(text), sys.stderr)


def progress_stream() -> TextIO:
    """The stream for progress: stderr, or one that discards everything with `--quiet` or if another
    process prints.
    """
    # no stream that a test for a terminal takes for one: nothing is then rewritten in place
    return _Nowhere() if NOW.is_quiet or NOW.is_silent else sys.stderr


class _Nowhere(io.StringIO):
    """A stream that discards text and is not a terminal."""

    def write(self, text: str, /) -> int:
        return len(text)


def _say(text: str, stream: TextIO) -> None:
    if NOW.is_silent:
        return
    try:
        # flushed at once: messages on stderr and results on stdout then interleave as they were
        # said
        print(text, file=stream, flush=True)
    # before OSError, of which it is one: a reader that has gone is no failure of the command
    except BrokenPipeError as error:
        raise ReaderGoneError from error
    except OSError as error:  # which names no file, as a stream has none
        name = "output" if stream is sys.stdout else "error"
        error.filename = error.filename or f"the standard {name}"
        raise


def report(diagnostics: Sequence[Diagnostic], sources: Iterable[SourceText]) -> None:
    """Prints diagnostics to stderr in the format of `--format`, with lines of `sources`; with
    `--quiet` only errors. For SARIF they are stored until the end.
    """
    # kept even with `--quiet`: the log is the result, and readers of it filter by severity
    # themselves
    if NOW.messages == "sarif":
        NOW.kept.extend(diagnostics)
        return
    if NOW.is_quiet:
        diagnostics = [found for found in diagnostics if found.severity == "error"]
    if not diagnostics:
        return
    # what ends a command is its last line; a warning in full has a result after it and stands apart
    failed = any(diagnostic.severity == "error" for diagnostic in diagnostics)
    end = "\n" if NOW.messages == "full" and not failed else ""
    text = render(diagnostics, NOW.messages, sources, color=wants_color(sys.stderr))
    _say(text + end, sys.stderr)


def report_model(model: Model) -> None:
    """Prints the warnings of loading a model, with `--verbose` also its remarks.

    Raises BadParameter if the command would overwrite a file of the model or its data.
    """
    spare_files_of(model)
    remarks = model.remarks if NOW.is_verbose else ()
    report((*model.warnings, *remarks), model.sources)


def spare_files_of(model: Model) -> None:
    """Raises BadParameter if the command would overwrite a file of the model or its data."""
    if NOW.outputs:
        NOW.outputs.spare(_files_of(model))


def _files_of(model: Model) -> Iterator[Path]:
    """The files of the spec, its sub-models, their weights and its data."""
    from msnn.data.reading.files import matching

    yield model.path
    for part in model.parts:
        yield Path(part.path)
        if part.file is not None:
            yield part.file
    if model.spec.data is not None:
        for source in model.spec.data.source.values():
            for pattern in source.files:
                yield from matching(NOW.data_root or model.folder, pattern.value)


def wants_color(stream: TextIO) -> bool:
    """True if text to a stream is to have colours: by NO_COLOR (no-color.org), else by FORCE_COLOR,
    else on a terminal.
    """
    # no-color.org: present and not empty, whatever its value
    if os.environ.get("NO_COLOR"):
        return False
    forced = os.environ.get("FORCE_COLOR")
    if forced is not None and forced != "":
        return forced != "0"
    return is_live(stream)


def plain(value: Any) -> Any:
    """A JSON value in which null replaces NaN and infinity, also within lists and objects."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [plain(item) for item in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_FIRST = 1.0
"""Seconds before the first message; most simulations are shorter."""

_AGAIN = 0.1, 5.0
"""Seconds between two messages, on a terminal and elsewhere."""


class StepProgress:
    """A context that shows the progress of a simulation; on a terminal one line that is rewritten,
    and cleared at the end.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._live = stream, is_live(stream)
        self._began: tuple[float, int] | None = None
        """Time of the first call and its number of steps."""
        self._next = 0.0
        self._said = False

    def told(self, done: int, total: int) -> None:
        """Shows that `done` of `total` steps are complete, and the remaining time, at most every
        few seconds.
        """
        now = time.monotonic()
        if self._began is None:
            self._began, self._next = (now, done), now + _FIRST
        # at the end the result says it; a line "0 s left" above it would only stay there
        began, before = self._began
        # another simulation begins with fewer steps: of no step since there is no time to tell
        if now < self._next or done >= total or done <= before:
            return
        self._next = now + _AGAIN[0 if self._live else 1]
        # linear in the steps since the first call: what was done before, loading and compiling,
        # counts not
        left = (now - began) / (done - before) * (total - done)
        text = f"  {done:,} of {total:,} steps, {left:.0f} s left"
        # ECMA-48 EL 2 clears the whole line: a shorter text would leave the end of the longer one
        self._stream.write(f"\r\x1b[2K{text}" if self._live else f"{text}\n")
        self._stream.flush()
        self._said = True

    def __enter__(self) -> StepProgress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._said and self._live:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()


def append_summary(file: Path, text: str) -> None:
    """Appends Markdown to the file, which other steps of a pipeline may have written to; makes its
    folder if needed.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    # appended, not replaced: GitHub gives every step of a job the same file
    with file.open("a", encoding="utf-8") as page:
        page.write(f"{text}\n")


def answer(error: Exception) -> ExitCode:
    """Prints an error to stderr and returns the exit code. Unexpected exceptions print nothing and
    return BUG.
    """
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
