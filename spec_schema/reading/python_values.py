"""Writes values of Python as the text of a spec, and settings as the command line has them."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, cast

import yaml

Settings: TypeAlias = "Mapping[str, object] | Sequence[str]"
"""Values that replace those of a spec: `{"train.0.epochs": 5}`, or `["train.0.epochs=5"]`."""


def spec_text(spec: Mapping[str, object]) -> str:
    """A spec that is a mapping as YAML, so that diagnostics have lines to show.

    TypeError for what YAML has no word for: an object, a number that is not finite.
    """
    # wide lines: a formula that is broken would be another place in messages
    return yaml.safe_dump(_plain(spec), sort_keys=False, allow_unicode=True, width=100)


def setting_texts(settings: Settings) -> tuple[str, ...]:
    """Each setting as `path=value`, a line of YAML."""
    if not isinstance(settings, Mapping):
        return tuple(settings)
    return tuple(f"{path}={value_text(value)}" for path, value in settings.items())


def value_text(value: object) -> str:
    """One value on one line, as YAML and JSON both write it."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> Any:
    """Mappings, lists, texts and numbers; arrays and numbers of numpy become these."""
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
