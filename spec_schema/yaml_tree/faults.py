"""Says in the project's words what PyYAML's parser complains of."""

import re
from collections.abc import Iterable
from itertools import accumulate

import yaml

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import yaml_text as errors

_WORD_IN_FLOW = re.compile(r"[^\s,{}\[\]:]+$")
_LONGEST_WORD = 200
_GLUED = re.compile(r"[ ]*(?:- )?(?P<key>[^\W\d][\w.]*):(?P<value>[{\[\"']|[^\s:#]{1,20})")
_ODD_BLANK = re.compile("[\u00a0\u1680\u2000-\u200b\u202f\u205f\u2060\u3000\ufeff]")
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
    # the order of these matters: the first reason that fits is the nearest to what was meant
    if found == ":" and not text[:at].rpartition("\n")[2].strip():
        return errors.key_is_not_text("nothing", here)
    if found == "\t":
        return errors.tab(here)
    if "cannot start any token" in problem:
        return errors.reserved_start(found, here)
    if "mapping values are not allowed" in problem:
        return _colon_without_blank(at, source) or errors.second_colon(here)
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
        # the parser stops behind the backslash
        return errors.unknown_escape(source.span(at - 1, at + 1))
    if "quoted scalar" in scanning:
        return errors.open_quote(source.span(opened, opened + 1))
    if scanning == "while scanning a simple key":
        line_end = opened + len(text[opened:].splitlines()[0].rstrip())
        glued = _colon_without_blank(opened, source)
        return glued or errors.missing_colon(
            text[opened:line_end].strip(), source.span(opened, line_end)
        )
    if scanning.startswith("while parsing a block") or "block end" in problem:
        return errors.misplaced_line(here)
    return errors.other_syntax(problem, here)


def _colon_without_blank(at: int, source: SourceText) -> Diagnostic | None:
    """The fault of a line that begins with `key:` and goes on without a blank."""
    text = source.text
    begin = text.rfind("\n", 0, at) + 1
    before = text.rfind("\n", 0, max(begin - 1, 0)) + 1
    # YAML complains a line later where the word is the first of a mapping
    found = _GLUED.match(text, begin) or _GLUED.match(text, before)
    if found is None:
        return None
    colon = found.end("key")
    begin, end = colon - len(found["key"]), colon + 1 + len(found["value"])
    return errors.no_blank_after_colon(found["key"], found["value"], source.span(begin, end))


def odd_blanks(diagnostics: Iterable[Diagnostic], source: SourceText) -> tuple[Diagnostic, ...]:
    """The diagnostics, those of lines with a blank that is none replaced by one that says so."""
    lines = source.text.split("\n")
    starts = [0, *accumulate(len(line) + 1 for line in lines)]
    kept: list[Diagnostic] = []
    for diagnostic in diagnostics:
        span = diagnostic.span
        line = span.line - 1 if span is not None else -1
        odd = _ODD_BLANK.search(lines[line]) if 0 <= line < len(lines) else None
        if odd is None or diagnostic.severity != "error":
            kept.append(diagnostic)
        else:
            at = starts[line] + odd.start()
            kept.append(errors.odd_blank(ord(odd.group()), source.span(at, at + 1)))
    return tuple(dict.fromkeys(kept))


def _flow_fault(at: int, opened: int, source: SourceText) -> Diagnostic:
    text = source.text
    # a word ends where brackets begin: only what stands right before is looked at, however long
    # the text since the opening bracket is
    word = _WORD_IN_FLOW.search(text, max(opened, at - _LONGEST_WORD), at)
    bracketed = _BRACKETED.match(text, at)
    if word is not None and bracketed is not None:
        start, end = word.start(), bracketed.end()
        return errors.bracket_in_flow(text[start:end], source.span(start, end))
    return errors.open_bracket(text[opened], source.span(opened, opened + 1))
