"""Writes values of settings in one form, whoever gave them: the command line or Python."""

from __future__ import annotations

import math

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.python_values import value_text
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree

_FILE = "--set"


def one_form(setting: str) -> str:
    """A setting so that alike ones are alike in text: `train.0.lr=0.001` for `train.0.lr=1e-3`.

    Words that read back as themselves stand without quotes; what is no setting stays as it is.
    """
    path, equals, text = setting.partition("=")
    value = _value(text) if equals else None
    if value is None:
        return setting
    return f"{path.strip()}={_written(plain_value(value))}"


def shown_value(text: str) -> str:
    """A value as people read it: `0.001` for `1e-3`, texts without quotes."""
    plain = plain_value(_value(text))
    return plain if isinstance(plain, str) else _json(plain)


def plain_value(node: Node | None) -> object:
    """Mappings, lists, texts and numbers without their places."""
    match node:
        case Listing(items=items):
            return [plain_value(item) for item in items]
        case Table(entries=entries):
            return {key: plain_value(item) for key, item in entries.items()}
        case Scalar(value=value):
            return value
        case None:
            return None


def _value(text: str) -> Node | None:
    """The value of a line of YAML; None where it is none."""
    findings = Findings()
    # as the value of a key: that is where settings stand
    tree = None if "\n" in text else read_tree(SourceText(_FILE, f"value: {text}"), findings)
    alone = isinstance(tree, Table) and tuple(tree.entries) == ("value",) and not findings.failed
    return tree.entries["value"] if alone and isinstance(tree, Table) else None


def _written(plain: object) -> str:
    if isinstance(plain, str):
        read = _value(plain)
        # without quotes where YAML reads it as the same text
        if isinstance(read, Scalar) and read.value == plain:
            return plain
    return _json(plain)


def _json(plain: object) -> str:
    if isinstance(plain, float) and not math.isfinite(plain):
        # JSON has no NaN and no ∞, YAML has
        return ".nan" if math.isnan(plain) else f"{'-' if plain < 0 else ''}.inf"
    return value_text(plain)
