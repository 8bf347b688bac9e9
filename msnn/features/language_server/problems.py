"""Converts the results of a check to underlined problems and quick fixes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from msnn.features.language_server.knowledge import Examined
from msnn.features.language_server.positions import START, TextRange, range_of
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


@dataclass(frozen=True)
class Related:
    """A further place of a problem, possibly in another file, and a text about it."""

    path: str
    range: TextRange
    label: str


@dataclass(frozen=True)
class Problem:
    """A diagnostic as an editor shows it in one file: underlined range, text with notes and help,
    and related places.
    """

    diagnostic: Diagnostic
    range: TextRange
    text: str
    related: tuple[Related, ...]


@dataclass(frozen=True)
class Repair:
    """A quick fix: `text` replaces the range of the problem; `title` is shown to the user."""

    problem: Problem
    title: str
    text: str


def problems_of(examined: Examined, path: str) -> tuple[Problem, ...]:
    """One problem per diagnostic of a check, for the file at `path`.

    A diagnostic in the file of a sub-model is shown at its use, or at the start of the text if that
    is unknown.
    """
    return tuple(_problem(diagnostic, examined, path) for diagnostic in examined.diagnostics)


def repairs_of(problems: tuple[Problem, ...], path: str, chosen: TextRange) -> Iterator[Repair]:
    """The quick fixes for the problems whose place is in the file `path` and touches the range
    `chosen`.
    """
    for problem in problems:
        diagnostic = problem.diagnostic
        is_here = diagnostic.span is not None and diagnostic.span.file == path
        if is_here and diagnostic.replacement is not None and problem.range.touches(chosen):
            yield Repair(problem, _title(diagnostic.replacement), diagnostic.replacement)


def _title(text: str) -> str:
    if not text.strip():
        return "write a blank" if text else "remove it"
    return f"write `{text}`"


def _problem(diagnostic: Diagnostic, examined: Examined, path: str) -> Problem:
    places = [(span, label) for span, label in diagnostic.secondary]
    here = diagnostic.span
    # an editor shows diagnostics by file: what is wrong elsewhere is shown at a place that leads
    # there
    if here is not None and here.file != path:
        places = [(here, diagnostic.message), *places]
        # the `use:` that brings the file in, where the message names it
        here = next((span for span, _ in places if span.file == path), None)
    others = ((span, label) for span, label in places if span != here)
    related = tuple(Related(s.file, _range(s, examined), label) for s, label in others)
    return Problem(
        diagnostic,
        START if here is None else _range(here, examined),
        _text(diagnostic, path),
        related,
    )


def _range(span: Span, examined: Examined) -> TextRange:
    return range_of(span, examined.sources.get(span.file))


def _text(diagnostic: Diagnostic, path: str) -> str:
    span = diagnostic.span
    elsewhere = span is not None and span.file != path
    place = f"{span.file}:{span.line}:{span.column}: " if span is not None and elsewhere else ""
    lines = [f"{place}{diagnostic.message}", diagnostic.label, *diagnostic.notes]
    if diagnostic.help is not None:
        lines.append(f"help: {diagnostic.help}")
    return "\n".join(line for line in lines if line)
