"""Writes values of settings in one canonical form, given on the command line or in Python."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias, cast

import yaml

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.fields.quantities import split_quantity
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import UnitError
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree

Settings: TypeAlias = "Mapping[str, object] | Sequence[str]"
"""Values that replace those of a spec: `{"train.0.epochs": 5}`, or `["train.0.epochs=5"]`."""


def spec_text(spec: Mapping[str, object]) -> str:
    """The YAML text of a spec that is given as a mapping, so that diagnostics have lines to show.

    TypeError for values that YAML cannot express: other objects, and numbers that are not finite.
    """
    # wide lines: a formula that is broken would be another place in messages
    return yaml.safe_dump(_plain(spec), sort_keys=False, allow_unicode=True, width=100)


def setting_texts(settings: Settings) -> tuple[str, ...]:
    """The settings as texts `path=value`, from a mapping or from such texts."""
    if not isinstance(settings, Mapping):
        return tuple(settings)
    return tuple(f"{path}={value_text(value)}" for path, value in settings.items())


def value_text(value: object) -> str:
    """A value as one line of JSON, which is also YAML."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> Any:
    """The value made of mappings, lists, texts and numbers; arrays and numbers of numpy are
    converted.
    """
    # a string of numpy is a subclass of str that YAML does not know
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Mapping):
        pairs = cast("Mapping[object, object]", value).items()
        return {str(key): _plain(item) for key, item in pairs}
    if hasattr(value, "tolist"):  # of numpy, which need not be imported for it
        value = cast("Any", value).tolist()
    if isinstance(value, Sequence):
        return [_plain(item) for item in cast("Sequence[object]", value)]
    # NaN − NaN and ∞ − ∞ are NaN
    if isinstance(value, float) and value - value != 0.0:
        raise TypeError(f"a spec has no word for the number {value}")
    if value is None or isinstance(value, bool | int | float):
        return value
    raise TypeError(f"a spec has no word for a value of type {type(value).__name__}: {value!r}")


_FILE = "--set"
_WHOLE = 1e15
"""Below it a whole number has all its digits in a float, and reads as easily."""


# each training of a sweep asks it of the settings of its variant
@lru_cache(256)
def one_form(setting: str) -> str:
    """A setting in canonical form, so that equal settings have equal texts.

    Example: `train.0.lr=0.001` for `train.0.lr=1e-3`. Texts are quoted only where necessary. A text
    that is no setting is returned unchanged.
    """
    path, equals, text = setting.partition("=")
    value = _value(text) if equals else None
    if value is None:
        return setting
    return f"{one_path(path)}={_written(_with_one_form(plain_value(value)))}"


def one_path(path: str) -> str:
    """The path of a setting in canonical form: without quotes that YAML does not need."""
    found = _key(path)
    return found if found is not None and _key(found) == found else path.strip()


def shown_value(text: str) -> str:
    """A value as people read it: `0.001` for `1e-3`, texts without quotes."""
    plain = plain_value(_value(text))
    return plain if isinstance(plain, str) else _json(plain)


def plain_value(node: Node | None) -> object:
    """The value of a node as mappings, lists, texts and numbers, without their places in
    the file.
    """
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
    """The node of a value in one line of YAML; None if it is not valid."""
    findings = Findings()
    # as the value of a key: that is where settings stand
    tree = None if "\n" in text else read_tree(SourceText(_FILE, f"value: {text}"), findings)
    alone = isinstance(tree, Table) and tuple(tree.entries) == ("value",) and not findings.failed
    return tree.entries["value"] if alone and isinstance(tree, Table) else None


def _key(path: str) -> str | None:
    """The key of one line of YAML; None if it is not valid."""
    tree = None if "\n" in path else read_tree(SourceText(_FILE, f"{path}: 0"), Findings())
    return next(iter(tree.entries)) if isinstance(tree, Table) and len(tree.entries) == 1 else None


def _with_one_form(plain: object) -> object:
    """The value, in which quantities have canonical numbers, at any depth: `1 kg` for `1.0 kg`."""
    match plain:
        case str():
            return _one_quantity(plain)
        case list():
            return [_with_one_form(item) for item in cast("list[object]", plain)]
        case dict():
            entries = cast("dict[str, object]", plain).items()
            return {key: _with_one_form(item) for key, item in entries}
        case _:
            return plain


def _one_quantity(text: str) -> str:
    read = _value(text)
    parts = split_quantity(read) if isinstance(read, Scalar) else None
    if parts is None or not math.isfinite(float(parts[0].text)):
        return text
    number, unit = (part.text for part in parts)
    try:
        parse_unit(unit)
    except UnitError:
        return text
    return f"{_json(float(number))} {unit}"


def _written(plain: object) -> str:
    if isinstance(plain, str):
        read = _value(plain)
        # without quotes where YAML reads it as the same text
        if isinstance(read, Scalar) and read.value == plain:
            return plain
    return _json(plain)


def _json(plain: object) -> str:
    """The value as JSON text; NaN and infinity are written as in YAML."""
    match plain:
        case float() if not math.isfinite(plain):
            return ".nan" if math.isnan(plain) else f"{'-' if plain < 0 else ''}.inf"
        case float() if plain.is_integer() and abs(plain) < _WHOLE and repr(plain) != "-0.0":
            return f"{int(plain)}"  # 1.0 and 1 are one number, -0.0 and 0 are two
        case list():
            return f"[{', '.join(map(_json, cast('list[object]', plain)))}]"
        case dict():
            entries = cast("dict[str, object]", plain).items()
            return f"{{{', '.join(f'{value_text(key)}: {_json(item)}' for key, item in entries)}}}"
        case _:
            return value_text(plain)
