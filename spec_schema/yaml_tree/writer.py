"""Writes plain values as YAML that reads back the same, with quotes where they are needed."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from spec_schema.diagnostics.source import printable, printable_json
from spec_schema.yaml_tree.nodes import core_value

_PLAIN = re.compile(r"[A-Za-z0-9Ͱ-Ͽ_+(./-][^\"'#:\[\]{},&*!|>%@`\\\x00-\x1f\x7f-\xa0]*")
_SHORT = 60


def yaml_text(values: Mapping[str, Any]) -> str:
    """The mapping as YAML text: mappings and lists of mappings as blocks, lists of values
    in [ ].
    """
    return "".join(f"{line}\n" for line in _table(values))


def scalar_text(value: Any, *, in_flow: bool = False) -> str:
    """A text, number or boolean as it is written in YAML, in quotes if needed."""
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return repr(value)
        case _:
            text = str(value)
            # in [ ] a comma within parentheses would end the item
            return text if _is_plain(text) and not (in_flow and "(" in text) else quoted(text)


def quoted(text: str) -> str:
    """The text in double quotes, without control characters."""
    return printable_json(json.dumps(text, ensure_ascii=False))


def _is_plain(text: str) -> bool:
    kept = _PLAIN.fullmatch(text) is not None and text == text.strip() == printable(text)
    # `-x` is a formula, `- x` an item of a list
    starts_list = text.startswith(("- ", "-")) and text[1:2] in {"", " "}
    return kept and not starts_list and isinstance(core_value(text), str) and text[:3] != "---"


def _table(values: Mapping[str, Any]) -> Iterator[str]:
    for key, value in values.items():
        yield from _entry(f"{scalar_text(key)}:", value)


def _entry(start: str, value: Any) -> Iterator[str]:
    match value:
        case Mapping() if value:
            yield start
            yield from (f"  {line}" for line in _table(cast("Mapping[str, Any]", value)))
        case Mapping():
            yield f"{start} {{}}"
        case list():
            yield from _list(start, cast("Sequence[Any]", value))
        case _:
            yield f"{start} {scalar_text(value)}"


def _list(start: str, items: Sequence[Any]) -> Iterator[str]:
    if not any(isinstance(item, Mapping | list) for item in items):
        short = f"{start} [{', '.join(scalar_text(item, in_flow=True) for item in items)}]"
        # an empty list has no block form
        if len(short) <= _SHORT or not items:
            yield short
            return
    yield start
    for item in items:
        lines = list(_item(item))
        yield f"  - {lines[0]}"
        yield from (f"    {line}" for line in lines[1:])


def _item(item: Any) -> list[str]:
    match item:
        case Mapping() if item:
            return list(_table(cast("Mapping[str, Any]", item)))
        case Mapping():
            return ["{}"]
        case _:
            return [scalar_text(item)]
