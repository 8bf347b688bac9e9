"""Formats diagnostics: in full with source lines, one per line, JSON, GitHub, SARIF."""

import json
from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias, assert_never

from spec_schema.diagnostics.diagnostic import Diagnostic, describe, in_full
from spec_schema.diagnostics.source import SourceText, Span, printable_json

Format: TypeAlias = Literal["full", "concise", "json", "github", "sarif"]
JSON_VERSION = 1


def render(
    diagnostics: Sequence[Diagnostic],
    format: Format = "full",
    sources: Iterable[SourceText] = (),
    color: bool = False,
) -> str:
    """The text of all diagnostics, without a line end after the last line.

    `sources` are the files whose lines `full` shows; a place in another file is only named.
    Colours are used by `full` alone. Control characters of files are shown as `�`.
    """
    if format not in ("json", "sarif"):  # which escape them
        diagnostics = [diagnostic.printable for diagnostic in diagnostics]
    match format:
        case "full":
            return in_full(diagnostics, sources, color=color)
        case "concise":
            return "\n".join(describe(diagnostic) for diagnostic in diagnostics)
        case "json":
            record = {"version": JSON_VERSION, "diagnostics": records(diagnostics)}
            return printable_json(json.dumps(record, ensure_ascii=False, indent=2))
        case "sarif":
            # most runs find nothing that needs the explanations
            from spec_schema.diagnostics.sarif import sarif_log

            log = json.dumps(sarif_log(diagnostics), ensure_ascii=False, indent=2)
            return printable_json(log)
        case "github":
            return "\n".join(_annotation(diagnostic) for diagnostic in diagnostics)
        case _:
            assert_never(format)


def records(diagnostics: Iterable[Diagnostic]) -> list[dict[str, Any]]:
    """The diagnostics as a list of JSON objects."""
    return [_record(diagnostic) for diagnostic in diagnostics]


def _record(diagnostic: Diagnostic) -> dict[str, Any]:
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity,
        "message": diagnostic.message,
        "place": _place(diagnostic.span),
        "label": diagnostic.label,
        "secondary": [
            {"place": _place(span), "label": label} for span, label in diagnostic.secondary
        ],
        "notes": list(diagnostic.notes),
        "help": diagnostic.help,
    }


def _place(span: Span | None) -> dict[str, Any] | None:
    if span is None:
        return None
    return {
        "file": span.file,
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }


def _annotation(diagnostic: Diagnostic) -> str:
    """A diagnostic as a line that GitHub Actions shows at its place in the code."""
    kind = {"error": "error", "warning": "warning", "note": "notice"}[diagnostic.severity]
    properties = {"title": diagnostic.code}
    span = diagnostic.span
    if span is not None:
        properties |= {"file": span.file, "line": str(span.line), "endLine": str(span.end_line)}
        if span.line == span.end_line:
            # GitHub's end column is inclusive, and only means something within one line.
            last = max(span.column, span.end_column - 1)
            properties |= {"col": str(span.column), "endColumn": str(last)}
    given = ",".join(
        f"{key}={_escaped(value).replace(':', '%3A').replace(',', '%2C')}"
        for key, value in properties.items()
    )
    lines = [diagnostic.message, *diagnostic.notes]
    if diagnostic.help is not None:
        lines.append(f"help: {diagnostic.help}")
    return f"::{kind} {given}::{_escaped(chr(10).join(lines))}"


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
