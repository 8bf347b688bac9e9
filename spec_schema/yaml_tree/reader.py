"""Reads the text of a spec as strict YAML 1.2 (core schema), or JSON, into nodes with places."""

import json
import re
from collections.abc import Iterable
from itertools import accumulate
from typing import Any, cast

import yaml

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import yaml_text as errors
from spec_schema.yaml_tree.builder import StoppedError, TreeBuilder
from spec_schema.yaml_tree.nodes import Node, Scalar

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
    """The diagnostics; on lines with an unusual white space, one that says so replaces them."""
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


LARGEST = 1_000_000
_ASCII_CONTROL = re.compile("[^\t\n\r\x20-\x7e]")
# What PyYAML refuses, and the line separators of YAML 1.1 that 1.2 reads as plain characters.
# Compiled when it is needed: a table of all characters takes Python longer than a small spec.
_CONTROL = (
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)


def read_tree(source: SourceText, findings: Findings) -> Node | None:
    """Parses the text of a spec to a tree; None after reporting an error."""
    text = source.text
    start = source.span(0, 1)
    if len(text) > LARGEST:
        findings.report(errors.too_large(len(text), LARGEST, start))
        return None
    control = _ASCII_CONTROL.search(text) if text.isascii() else re.search(_CONTROL, text)
    if control is not None:
        span = source.span(control.start(), control.end())
        findings.report(errors.control_character(ord(control.group()), span))
        return None
    # JSON is YAML but for its rules, which a YAML parser does not hold it to
    if source.path.endswith(".json") and not _is_json(source, findings):
        return None
    return _compose(source, findings)


def _compose(source: SourceText, findings: Findings) -> Node | None:
    """The tree by PyYAML's C parser if it is there; the Python parser runs again to report
    errors.
    """
    # many times faster, and there wherever PyYAML was installed as a wheel
    fast: Any = getattr(yaml, "CSafeLoader", None)
    if fast is not None:
        own = Findings()
        try:
            root = _build(source, fast, own)
        except yaml.YAMLError:
            pass
        else:
            findings.report(*odd_blanks(own.in_order, source))
            return root
    own = Findings()
    try:
        root = _build(source, yaml.SafeLoader, own)
    except yaml.MarkedYAMLError as error:
        own.report(syntax_fault(error, source))
        root = None
    findings.report(*odd_blanks(own.in_order, source))
    return root


def _build(source: SourceText, loader: Any, findings: Findings) -> Node | None:
    text = source.text
    if source.path.endswith(".json"):
        # Between the tokens of JSON tabs are blanks; within its texts they are not allowed.
        text = text.replace("\t", " ")
    builder = TreeBuilder(source, text, findings)
    try:
        for event in cast("Any", yaml).parse(text, Loader=loader):
            builder.take(event)
    except StoppedError:
        return None
    root = builder.root
    if root is None or (isinstance(root, Scalar) and root.is_empty):
        findings.report(errors.empty_file(source.span(0, 1)))
        return None
    return root


def _is_json(source: SourceText, findings: Findings) -> bool:
    try:
        json.loads(source.text)
    except json.JSONDecodeError as error:
        span = source.span(error.pos, error.pos + 1)
        findings.report(errors.malformed_json(error.msg, span))
        return False
    except RecursionError:
        findings.report(errors.malformed_json("nested too deep", source.span(0, 1)))
        return False
    except ValueError:
        findings.report(errors.malformed_json("a number has too many digits", source.span(0, 1)))
        return False
    return True
