"""Finds fields of entries that no spec can fill: of plain types, or with wrong defaults."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined

from spec_schema.fields.entry import Entry, LateEntry
from spec_schema.fields.leaf import Gathering, KeyAndValueSpan, LeafField, Located

_INSTEAD = {
    bool: "`Switch`",
    int: "`PositiveCount` or `NonNegativeCount`",
    float: "`PositiveNumber`, `NonNegativeNumber` or `QuantityField`",
    str: "`Text`, `NewName`, `Reference` or `choice(...)`",
    list: "`ManyOf[...]`",
    tuple: "`ManyOf[...]`",
    dict: "`EntriesOf[...]`",
    Located: "`NewName` or `Reference`",
}
"""The field types of `msnn.extending` by the plain type that they replace."""


def fault_of_fields(kind: type[Entry]) -> str | None:
    """The first field with a fault, as a sentence that names the repair; None without one."""
    for name, field in kind.model_fields.items():
        whole = f"the field `{name}` of {kind.__name__}"
        if name == "place":
            if field.annotation is not KeyAndValueSpan:
                return f"{whole} has the name of the entry's place in the spec: rename it"
            continue
        wrong = _plain_type(field.annotation, field.metadata)
        if wrong is not None:
            return f"{whole} has the type `{wrong.__name__}`: use {_INSTEAD[wrong]}"
        default = field.get_default(call_default_factory=True, validated_data={})
        if default is not PydanticUndefined and not _fits(
            default, field.annotation, field.metadata
        ):
            return f"{whole} has the default {default!r}, which its type does not have"
    return None


def _plain_type(annotation: Any, metadata: list[Any]) -> type | None:
    """A plain type in the annotation that reads no value of a spec."""
    if any(isinstance(each, LeafField | LateEntry) for each in metadata):
        return None
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _plain_type(arguments[0], [*arguments[1:]])
    if origin is Union or origin is types.UnionType:
        found = (_plain_type(each, []) for each in arguments)
        return next((each for each in found if each is not None), None)
    if any(isinstance(each, Gathering) for each in metadata):
        # of a mapping the values: its keys are names
        items = arguments[-1:] if origin is not tuple else arguments[:1]
        return next((found for each in items if (found := _plain_type(each, []))), None)
    plain = origin or annotation
    return plain if isinstance(plain, type) and plain in _INSTEAD else None


def _fits(value: Any, annotation: Any, metadata: list[Any]) -> bool:
    """True if a value has the type and the limits of a field."""
    limits = [each.schema for each in metadata if isinstance(each, LeafField)]
    if isinstance(value, int | float) and not all(_within(value, each) for each in limits):
        return False
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _fits(value, arguments[0], [*arguments[1:]])
    if origin is Union or origin is types.UnionType:
        return any(_fits(value, each, []) for each in arguments)
    if origin is Literal:
        return value in arguments
    if isinstance(annotation, LeafField):
        words = annotation.schema.get("enum")
        return words is None or value in words
    if origin is tuple:
        return isinstance(value, tuple) and all(
            _fits(each, arguments[0], [])
            for each in value  # pyright: ignore[reportUnknownVariableType]
        )
    kind = origin or annotation
    if kind is Any:
        return True
    if kind is type(None):
        return value is None
    if kind in (int, float):
        is_number = isinstance(value, int if kind is int else int | float)
        return is_number and not isinstance(value, bool)
    return not isinstance(kind, type) or isinstance(value, kind)


def _within(value: float, limits: Mapping[str, Any]) -> bool:
    """True within the limits of a JSON Schema of numbers."""
    return (
        limits.get("minimum", value) <= value <= limits.get("maximum", value)
        and value > limits.get("exclusiveMinimum", value - 1)
        and value < limits.get("exclusiveMaximum", value + 1)
    )
