"""Signatures of what plug-ins call: the builder, the context of a layer, readers and messages."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any

from msnn import extending
from spec_schema.units.unit import Unit
from tests.docs.markdown import table

_READERS = [name for name in extending.__all__ if name.startswith("read_")]
_OUTPUT = ["error", "warning", "remark", "report", "note", "result", "json_result", "parse_unit"]
_OF_PLUGINS = {"Builder": "GraphBuilder", "Context": "LayerContext", "Node": "NodeId"}
"""Names of `msnn.extending` by those of the classes in msnn, without `Plugin`."""


def plugin_builder() -> str:
    """A row for each method of the builder."""
    return _members(extending.GraphBuilder)


def plugin_context() -> str:
    """A row for each member of the context of a layer."""
    return _members(extending.LayerContext)


def plugin_functions() -> str:
    """A row for each reader of arguments, and for each function that makes or prints messages."""
    rows = ((name, getattr(extending, name)) for name in (*_READERS, *_OUTPUT))
    return _table("function", rows)


def _members(kind: type) -> str:
    return _table("member", ((n, m) for n, m in vars(kind).items() if not n.startswith("_")))


def _table(header: str, members: Iterable[tuple[str, Any]]) -> str:
    rows = [(f"`{_written(name, member)}`", _sentence(member)) for name, member in members]
    return table((header, "what it is"), rows)


def _written(name: str, member: property | Callable[..., object]) -> str:
    if isinstance(member, property):
        return name
    signature = inspect.signature(member)
    shown: list[str] = []
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in shown:
            shown.append("*")
        if parameter.name != "self":
            shown.append(_parameter(parameter))
    return f"{name}({', '.join(shown)})"


def _parameter(parameter: inspect.Parameter) -> str:
    kinds = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}
    kind = re.sub(r"Plugin(\w+)", lambda m: _OF_PLUGINS[m[1]], _kind(parameter.annotation))
    text = f"{kinds.get(parameter.kind, '')}{parameter.name}: {kind}"
    if parameter.default is parameter.empty:
        return text
    unit = parameter.default
    default = f"parse_unit('{unit.text}')" if isinstance(unit, Unit) else repr(unit)
    return f"{text} = {default}"


def _kind(annotation: object) -> str:
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    # without the names of modules
    return re.sub(r"\b\w+\.", "", text)


def _sentence(member: object) -> str:
    first = (inspect.getdoc(member) or "").partition("\n\n")[0]
    assert first, member
    return " ".join(first.split())
