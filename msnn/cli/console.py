"""Prints the output of a command: results to stdout, the rest to stderr, with optional colours."""

from __future__ import annotations

import io
import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from msnn.cli.manners import NOW
from msnn.errors.failures import ReaderGoneError
from msnn.terminals import is_live
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.render import render
from spec_schema.diagnostics.source import SourceText, printable, printable_json

# `msnn.model` loads the compiler, which `fmt`, `explain` and `schema` do without
if TYPE_CHECKING:
    from msnn.model.model import Model

JSON_VERSION = 1
"""Version of `--format json`; incremented for incompatible changes."""


def result(text: str) -> None:
    """Writes the result to stdout, or at the end to the file of `-o`.

    Writes nothing if the result is a SARIF log.
    """
    if NOW.messages != "sarif":
        _written(text)


def sarif_result() -> None:
    """Prints the log of all diagnostics with `--format sarif`."""
    if NOW.messages == "sarif":
        _written(render(NOW.kept, "sarif"))


def _written(text: str) -> None:
    if NOW.output is None:
        _say(text, sys.stdout)
    else:
        NOW.results.append(text)


def json_result(command: str, content: dict[str, Any]) -> None:
    """The result as JSON with its version."""
    result(json_text(command, content))


def json_text(command: str, content: dict[str, Any]) -> str:
    """A result as JSON text with its version; NaN and infinity become null."""
    record = {"version": JSON_VERSION, "command": command, **content}
    text = json.dumps(plain(record), ensure_ascii=False, indent=2, allow_nan=False)
    return printable_json(text)


def note(text: str) -> None:
    """Prints a hint in one line."""
    if not NOW.is_quiet:
        _say(printable(text), sys.stderr)


def progress_stream() -> TextIO:
    """The stream for progress; discards output with `--quiet`."""
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
    """Prints diagnostics to stderr in the format of `--format`; full ones are separated by blank
    lines.
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

    Raises the errors of `spare_files_of`.
    """
    spare_files_of(model)
    remarks = model.remarks if NOW.is_verbose else ()
    report((*model.warnings, *remarks), model.sources)


def spare_files_of(model: Model) -> None:
    """A usage error if the command would overwrite a file of the model or its data."""
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
    """True if a stream shows colours: NO_COLOR (no-color.org), FORCE_COLOR, or a terminal."""
    # no-color.org: present and not empty, whatever its value
    if os.environ.get("NO_COLOR"):
        return False
    forced = os.environ.get("FORCE_COLOR")
    if forced is not None and forced != "":
        return forced != "0"
    return is_live(stream)


def plain(value: Any) -> Any:
    """A JSON value with NaN and infinity replaced by null."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [plain(item) for item in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value
