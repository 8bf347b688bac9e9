"""Says in the project's words what PyYAML's parser complains of."""

import re

import yaml

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import yaml_text as errors

_WORD_IN_FLOW = re.compile(r"[^\s,{}\[\]:]+$")
_BRACKETED = re.compile(r"\[[^\[\]\n]*\]")
_ALIAS = re.compile(r"\*[^\s,\]}]*")


def syntax_fault(error: yaml.MarkedYAMLError, source: SourceText) -> Diagnostic:
    """The diagnostic of a fault that the pure Python parser found.

    The C parser words and places some faults otherwise, so the caller asks the Python parser again.
    """
    problem = error.problem or ""
    mark = error.problem_mark or error.context_mark
    at = mark.index if mark is not None else 0
    opened = error.context_mark.index if error.context_mark is not None else at
    text = source.text
    found = text[at : at + 1]
    here = source.span(at, at + 1)
    scanning = error.context or ""
    if found == ":" and not text[:at].rpartition("\n")[2].strip():
        return errors.key_is_not_text("nothing", here)
    if found == "\t":
        return errors.tab(here)
    if "cannot start any token" in problem:
        return errors.reserved_start(found, here)
    if "mapping values are not allowed" in problem:
        return errors.second_colon(here)
    if scanning in {"while scanning an alias", "while scanning an anchor"}:
        alias = _ALIAS.match(text, opened)
        end = alias.end() if alias else opened + 1
        return errors.stray_alias(text[opened:end], source.span(opened, end))
    if scanning == "while scanning a block scalar":
        return errors.block_text(text[opened : opened + 1], source.span(opened, opened + 1))
    if "sequence entries are not allowed" in problem:
        return errors.misplaced_item(here)
    if scanning in {"while parsing a flow mapping", "while parsing a flow sequence"}:
        return _flow_fault(at, opened, source)
    if "double-quoted scalar" in scanning:
        return errors.unknown_escape(source.span(at - 1, at + 1))
    if "quoted scalar" in scanning:
        return errors.open_quote(source.span(opened, opened + 1))
    if scanning == "while scanning a simple key":
        line_end = opened + len(text[opened:].splitlines()[0].rstrip())
        return errors.missing_colon(source.span(opened, line_end))
    if scanning.startswith("while parsing a block") or "block end" in problem:
        return errors.misplaced_line(here)
    return errors.other_syntax(problem, here)


def _flow_fault(at: int, opened: int, source: SourceText) -> Diagnostic:
    text = source.text
    word = _WORD_IN_FLOW.search(text, opened, at)
    bracketed = _BRACKETED.match(text, at)
    if word is not None and bracketed is not None:
        start, end = word.start(), bracketed.end()
        return errors.bracket_in_flow(text[start:end], source.span(start, end))
    return errors.open_bracket(text[opened], source.span(opened, opened + 1))
