"""Finds the names and calls that the expressions of an entry contain, anywhere in the entry."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias, cast

from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Call, Member, Name
from spec_schema.fields.entry import Entry
from spec_schema.fields.formulas import Prediction
from spec_schema.fields.leaf import Located
from spec_schema.sections.layers import CustomMembership

Reference: TypeAlias = Name | Member | Prediction | CustomMembership


def references(value: Any) -> Iterator[Reference]:
    """Yields every name, member, prediction and membership function in an expression, an entry, or
    a section, in the order of the text.
    """
    return (part for part in _parts(value) if isinstance(part, Reference))


def calls_in(value: Any) -> Iterator[Call]:
    """Yields every call in an expression, an entry, or a section, also calls within arguments of
    calls.
    """
    return (part for part in _parts(value) if isinstance(part, Call))


def names_in(value: Any) -> Iterator[str]:
    """Yields the names that the formulas of an entry use: bare names, functions, and of a member
    such as `plant.k` the name before the dot.
    """
    for reference in references(value):
        match reference:
            case Name(name=name) | CustomMembership(function=Located(value=name)):
                yield name
            case Member(base=base):
                yield base
            case Prediction():
                pass


def _parts(value: Any) -> Iterator[Reference | Call]:
    """Yields names and calls in a value. It walks all fields of entries and expressions, so that no
    new field is forgotten.
    """
    match value:
        case None | str() | int() | float() | Span() | Located():  # most of what there is
            return
        case Name() | Member() | Prediction() | CustomMembership():
            yield value
        case Entry():
            for field in type(value).model_fields:
                yield from _parts(getattr(value, field))
        case tuple():
            for part in cast("tuple[Any, ...]", value):
                yield from _parts(part)
        case Mapping():
            for part in cast("Mapping[str, Any]", value).values():
                yield from _parts(part)
        case _ if dataclasses.is_dataclass(value):
            # the call itself, and then what it is made of: its function is a reference too
            if isinstance(value, Call):
                yield value
            for field in dataclasses.fields(value):
                yield from _parts(getattr(value, field.name))
        case _:
            return
