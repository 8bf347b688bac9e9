"""Finds what the expressions of an entry refer to, wherever in the entry they stand."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias, cast

from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Member, Name
from spec_schema.fields.entry import Entry
from spec_schema.fields.formulas import Prediction
from spec_schema.fields.located import Located
from spec_schema.sections.layers.fuzzy_sets import CustomMembership

Reference: TypeAlias = Name | Member | Prediction | CustomMembership


def references(value: Any) -> Iterator[Reference]:
    """Every reference in an expression, an entry, or a section, in the order of the text.

    Fields are walked by reflection, so that a field that is added later is not forgotten.
    """
    match value:
        case None | str() | int() | float() | Span() | Located():  # most of what there is
            return
        case Name() | Member() | Prediction() | CustomMembership():
            yield value
        case Entry():
            for field in type(value).model_fields:
                yield from references(getattr(value, field))
        case tuple():
            for part in cast("tuple[Any, ...]", value):
                yield from references(part)
        case Mapping():
            for part in cast("Mapping[str, Any]", value).values():
                yield from references(part)
        case _ if dataclasses.is_dataclass(value):
            for field in dataclasses.fields(value):
                yield from references(getattr(value, field.name))
        case _:
            return


def names_in(value: Any) -> Iterator[str]:
    """The names that the formulas of an entry use: its bare names, bases of members, functions."""
    for reference in references(value):
        match reference:
            case Name(name=name) | CustomMembership(function=Located(value=name)):
                yield name
            case Member(base=base):
                yield base
            case Prediction():
                pass
