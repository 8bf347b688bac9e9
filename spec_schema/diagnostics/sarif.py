"""Formats diagnostics as SARIF 2.1.0, which code hosts display."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import quote

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.explain import explain
from spec_schema.diagnostics.source import Span
from spec_schema.version import __version__

_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"


def sarif_log(diagnostics: Iterable[Diagnostic]) -> dict[str, Any]:
    """One run of msnn: a rule for each code that was found, with its explanation, and the results.

    Files below the current folder are named relative to it, so that a host finds them in its
    checkout.
    """
    diagnostics = tuple(diagnostics)
    # only codes that were found: a host shows all rules of a run
    codes = sorted({diagnostic.code for diagnostic in diagnostics})
    driver = {"name": "msnn", "version": __version__, "rules": [_rule(code) for code in codes]}
    run = {
        "tool": {"driver": driver},
        # columns of spans count characters, not units of UTF-16 or bytes
        "columnKind": "unicodeCodePoints",
        "results": [
            _result(diagnostic, codes.index(diagnostic.code)) for diagnostic in diagnostics
        ],
    }
    return {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}


def _rule(code: str) -> dict[str, Any]:
    explanation = explain(code)
    return {
        "id": code,
        "shortDescription": {"text": explanation.meaning},
        "help": {"text": explanation.text, "markdown": explanation.page},
        "defaultConfiguration": {"level": "error" if code.startswith("E") else "warning"},
    }


def _result(diagnostic: Diagnostic, rule: int) -> dict[str, Any]:
    lines = [diagnostic.message, *diagnostic.notes]
    if diagnostic.help is not None:
        lines.append(f"help: {diagnostic.help}")
    result: dict[str, Any] = {
        "ruleId": diagnostic.code,
        "ruleIndex": rule,
        "level": diagnostic.severity,
        "message": {"text": "\n".join(lines)},
    }
    if diagnostic.span is not None:
        result["locations"] = [_location(diagnostic.span, diagnostic.label)]
    if diagnostic.secondary:
        result["relatedLocations"] = [_location(*place) for place in diagnostic.secondary]
    return result


def _location(span: Span, label: str) -> dict[str, Any]:
    # ends are exclusive in SARIF as in spans
    region = {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.end_line,
        "endColumn": span.end_column,
    }
    place = {"artifactLocation": {"uri": _uri(span.file)}, "region": region}
    return {"physicalLocation": place} | ({"message": {"text": label}} if label else {})


def _uri(file: str) -> str:
    path = Path(file)
    if not path.is_absolute():
        return quote(path.as_posix())
    here = Path.cwd()
    # a host looks for relative names in its checkout, and takes absolute ones for another machine's
    return quote(path.relative_to(here).as_posix()) if path.is_relative_to(here) else path.as_uri()
