"""Reads the text of a spec as strict YAML 1.2 (core schema), or JSON, into nodes with places."""

import json
import re
from typing import Any, cast

import yaml

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import yaml_text as errors
from spec_schema.yaml_tree.builder import StoppedError, TreeBuilder
from spec_schema.yaml_tree.faults import odd_blanks, syntax_fault
from spec_schema.yaml_tree.nodes import Node, Scalar

LARGEST = 1_000_000
_ASCII_CONTROL = re.compile("[^\t\n\r\x20-\x7e]")
# What PyYAML refuses, and the line separators of YAML 1.1 that 1.2 reads as plain characters.
# Compiled when it is needed: a table of all characters takes Python longer than a small spec.
_CONTROL = (
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)


def read_tree(source: SourceText, findings: Findings) -> Node | None:
    """The root of the file; None when its text could not be read, the reason being reported."""
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
    """The tree by the C parser where there is one; its complaints are left to the Python parser."""
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
